"""The server of the page: it answers browsers, and sends every page each change of the folder."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import socket
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from palpate import ConfigurationError, OutputError, UserError
from palpate_engine import error_text
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.page.datagrams import pack, pack_rows
from palpate_kit.page.gate import GREETING, GuardedConnection, answer_request, page_files
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from palpate_desk import page_messages
from palpate_desk.action import Action
from palpate_desk.curve_answers import CurveAnswer, curve_answer, reader_with_model
from palpate_desk.desk import Desk, one_curve
from palpate_desk.fact_form import fact_mistakes, facts_message, open_facts_of
from palpate_desk.folder_view import exported, folder_message, row_messages
from palpate_desk.refits import Refits, Worker

_MAX_PAGES = 16  # a choice
_TOKEN_SIZE = 16  # random bytes in the address, a choice: nobody guesses 128 bits
_MAX_CACHED_CURVES = 64  # whose samples are kept, a choice: some 5 MB
_FILE_CHECK_INTERVAL = 1.0  # [s] between two looks whether files have changed: a choice
_CLOSE_TIMEOUT = 1.0  # [s] for browsers to receive the last messages: a choice
_TRY_AGAIN_LATER = 1013  # code of a closed WebSocket (IANA registry)
_FILES = page_files(
    "palpate_desk",
    ("index.html", "desk.css", "main.js", "facts.js", "table.js", "curve.js", "points.js", "keys.js"),
)


class DeskServer:
    """Server of the pages of one desk."""

    def __init__(self, desk: Desk, read_only: bool, workers: int | None) -> None:
        """Serve an open folder (a desk); at most so many `workers` fit (None: one for each core)."""
        self.desk, self.read_only = desk, read_only
        self.token = secrets.token_urlsafe(_TOKEN_SIZE)
        self._pages: dict[ServerConnection, page_messages.CurveQuestion | None] = {}  # latest question of each page
        self._cache: OrderedDict[tuple[str, str], CurveAnswer] = OrderedDict()  # by name and settings, last used last
        self._worker = Worker()
        self._refits = Refits(self._worker, self._take, workers)
        self._tasks = set[asyncio.Task[None]]()  # the loop alone would not keep a task alive
        self._refitted: list[str] = []  # curves that the present refit of all has fitted
        self._orders: dict[type, Callable[[Any], None]] = {
            page_messages.MarkOrder: lambda m: self._report_change(desk.mark(m.curve, m.mark, m.reason), [m.curve]),
            page_messages.SetOrder: lambda m: self._report_change(desk.set(m.assignment, m.where)),
            page_messages.TipOrder: lambda m: self._report_change(desk.set_part(m.do, m.value)),
        }

    async def run(self, listener: socket.socket) -> None:
        """Serve the pages until cancelled; then end them, and compact the tables of fits.

        A message has a size limit; a browser has a time to greet, and one to take the last messages.
        """
        logger = logging.getLogger("palpate_desk")  # of websockets, whose errors the pages get
        logger.disabled = True
        async with serve(
            self._serve, sock=listener, process_request=self._admit, compression=None, logger=logger,
            max_size=page_messages.MAX_MESSAGE_SIZE, server_header=None, open_timeout=GREETING,
            close_timeout=_CLOSE_TIMEOUT, create_connection=GuardedConnection,
        ):  # fmt: skip
            try:
                await self._watch_files()
            finally:
                self._refits.cancel()
                self._tell({"kind": "over"})
                self._worker.close()
                if not self.read_only:
                    self.desk.compact()

    async def _watch_files(self) -> None:
        """Read the files again, and send them to every page, whenever another program has changed them."""
        while True:
            await asyncio.sleep(_FILE_CHECK_INTERVAL)
            with self._reported_errors():
                if self.desk.changed_outside and not self._refits.running:
                    self.desk.reload()
                    self._tell(self._folder())
                    self._tell({"kind": "note", "text": "another program has changed files of the folder"})

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file of the page, a refusal, or None for a connection that is admitted."""
        return answer_request(request, self.token, _FILES)

    async def _serve(self, page: ServerConnection) -> None:
        """Send a page the folder, then answer its messages until it closes."""
        if len(self._pages) >= _MAX_PAGES:
            await page.close(_TRY_AGAIN_LATER, "too many pages are open")
            return
        self._pages[page] = None
        has_folder = False
        with self._reported_errors(page):
            self._send(page, self._folder())
            has_folder = True
        if not has_folder:  # send it as soon as the folder can be read again
            self.desk.forget()
        # Questions for curves are answered by a task of their own, so that later ones replace those that wait.
        has_question = asyncio.Event()
        curve_task = asyncio.create_task(self._answer_curve_questions(page, has_question))
        with contextlib.suppress(ConnectionClosed):
            async for text in page:
                await self._answer(page, text, has_question)
        curve_task.cancel()
        self._pages.pop(page, None)

    @contextlib.contextmanager
    def _reported_errors(self, page: ServerConnection | None = None) -> Iterator[None]:
        """Send an error within the context to a page, or with None to all: none ends a connection."""
        try:
            yield
        except Exception as error:
            message = {"kind": "error", "text": error_text(error)}
            self._tell(message) if page is None else self._send(page, message)

    async def _answer(self, page: ServerConnection, text: str | bytes, has_question: asyncio.Event) -> None:
        """Answer a message of a page, if it is one of the permitted ones; errors are sent to the page.

        A question for a curve is kept, and sets the event `has_question`. Other messages ask for filtered names, open
        facts, a comparison, groups or an export, or order a refit, a fact or a change of marks or settings.
        """
        with self._reported_errors(page):
            message = page_messages.read_message(text)
            if self.read_only and not isinstance(message, page_messages.READ_ONLY_MESSAGES):
                raise ConfigurationError("the page was opened with --read-only")
            if isinstance(message, page_messages.CurveQuestion):
                self._pages[page] = message  # replaces one that waits
                has_question.set()
            elif isinstance(message, page_messages.FilterQuestion):
                names = self.desk.chosen(message.words)
                self._send(page, {"kind": "filter", "words": message.words, "names": names})
            elif isinstance(message, page_messages.RefitOrder):
                await self._refit(page, message)
            elif isinstance(message, page_messages.FactsQuestion):
                open_facts = await open_facts_of(self.desk, self._fitted_curve)
                self._send(page, facts_message(self.desk, open_facts, message.curve))
            elif isinstance(message, page_messages.FactsOrder):
                self._state_facts(page, message)
            elif isinstance(message, page_messages.CompareQuestion):
                await self._compare(page, message)
            elif isinstance(message, page_messages.GroupsQuestion | page_messages.ExportOrder):
                self._send(page, await exported(self.desk, message))
                if isinstance(message, page_messages.ExportOrder):
                    self._tell(self._state())
            else:
                self._orders[type(message)](message)

    def _state_facts(self, page: ServerConnection, message: page_messages.FactsOrder) -> None:
        """Write the answers of a form and fit the curves again, or send the mistakes of all fields."""
        self._demand_idle()
        mistakes = fact_mistakes(message.answers)
        if not mistakes:
            try:
                self._report_change(self.desk.state_facts(message.answers))
            except UserError as error:  # facts that contradict each other
                mistakes = {"": str(error)}
        self._send(page, {"kind": "mistakes", "mistakes": mistakes})
        if not mistakes:
            self._refit_all()

    def _demand_idle(self) -> None:
        """Raise ConfigurationError while curves are fitted."""
        if self._refits.running:
            raise ConfigurationError("curves are being fitted; cancel that first")

    async def _compare(self, page: ServerConnection, message: page_messages.CompareQuestion) -> None:
        """Send the comparison of two models on a curve, with the fit of the second one."""
        comparison = await exported(self.desk, message)
        reader = reader_with_model(self.desk.reader(message.curve), message.model)
        second_fit = await self._worker_answer(reader, self.desk.curve(message.curve), fitting=True)
        header = {**comparison, "curve": message.curve, "model": message.model, "error": second_fit.error}
        self._send(page, pack_rows(header, second_fit.time, second_fit.columns))

    async def _refit(self, page: ServerConnection, message: page_messages.RefitOrder) -> None:
        """Fit one curve or all that are not current, cancel that, or undo the latest change."""
        if message.do == "undo":
            self._report_change(self.desk.undo())
        elif message.do == "cancel":
            self._refits.cancel()
        elif message.do == "refit":
            self.desk.demand_file(message.curve)
            answer = await self._fitted_curve(message.curve)
            self.desk.note(one_curve(message.curve))
            self._store_rows(answer.rows)
            self._send_curve(page, answer, number=0)
        else:
            self._refit_all()

    def _refit_all(self) -> None:
        """Start a fit of all curves that are not current; raises ConfigurationError if none is, or one is running."""
        self._demand_idle()
        curves = [self.desk.curve(name) for name in self.desk.left()]
        if not curves:
            raise ConfigurationError("every curve is fitted with the present settings")
        self._refitted = []
        task = asyncio.create_task(self._refit_many([(self.desk.reader(curve.name), curve) for curve in curves]))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer_curve_questions(self, page: ServerConnection, has_question: asyncio.Event) -> None:
        """Answer the latest question of a page for a curve, whenever it has one; those that it replaced are dropped."""
        while True:
            await has_question.wait()
            has_question.clear()
            question = self._pages[page]
            if question is None:
                continue
            with self._reported_errors(page):  # after an error in one curve the page can look at others
                answer = await self._curve(question.curve)
                if not answer.settings and not self._is_outdated(question.curve):
                    answer = await self._curve(question.curve)  # it was fitted meanwhile
                if self._pages.get(page) is question:  # a late answer is dropped
                    self._send_curve(page, answer, question.number)

    async def _curve(self, name: str) -> CurveAnswer:
        """Return a curve, fitted if its row is current, else as it was read; from the cache if possible."""
        settings = self.desk.folder.key(self.desk.curve(name).name)
        is_current = not self._is_outdated(name)
        cached = self._cache.get((name, settings if is_current else ""))
        if cached is not None:
            self._cache.move_to_end((name, cached.settings))
            return cached
        return await self._computed_curve(name, fitting=is_current)

    def _is_outdated(self, name: str) -> bool:
        """Return True if a curve has no row by its present settings."""
        return any(row.state != "current" for row in self.desk.folder.rows_of(name))

    async def _fitted_curve(self, name: str) -> CurveAnswer:
        """Return a curve that is fitted now."""
        return await self._computed_curve(name, fitting=True)

    async def _computed_curve(self, name: str, fitting: bool) -> CurveAnswer:
        """Return a curve that is read, and fitted if requested, by the worker; keep it in the cache."""
        answer = await self._worker_answer(self.desk.reader(name), self.desk.curve(name), fitting)
        self._cache[name, answer.settings] = answer
        while len(self._cache) > _MAX_CACHED_CURVES:
            self._cache.popitem(last=False)
        return answer

    async def _worker_answer(self, reader: CurveReader, curve: Curve, fitting: bool) -> CurveAnswer:
        """Return the answer of the worker on a curve; raises OutputError where its process was killed."""
        try:
            return await self._worker.call(curve_answer, reader, curve, fitting)
        except BrokenProcessPool as error:
            raise OutputError(f"{curve.name}: the process that fitted it was killed: is the memory enough?") from error

    def _send_curve(self, page: ServerConnection, answer: CurveAnswer, number: int) -> None:
        """Send a page the samples of a curve, with the number of its question."""
        header = {
            "kind": "curve", "curve": answer.curve, "number": number, "error": answer.error, **answer.facts,
            "columns": ["height", "force", "model"],
        }  # fmt: skip
        self._send(page, pack_rows(header, answer.time, answer.columns))

    def _take(self, rows: list[Row]) -> None:
        """Store the rows of a curve of a refit of all."""
        self._refitted.append(rows[0]["curve"])
        self._store_rows(rows)

    def _store_rows(self, rows: list[Row]) -> None:
        """Add the rows of a curve to the table, and send them to every page; an error there cancels a refit of all."""
        curve = rows[0]["curve"]
        if rows[0]["settings"] != self.desk.folder.key(curve):
            return  # its settings have changed since the fit began
        try:
            stored_rows = self.desk.take_rows(rows)
        except UserError as error:  # such as a full disk
            self._refits.cancel()
            self._tell({"kind": "error", "text": str(error)})
            return
        self._tell_rows(stored_rows)

    def _tell_rows(self, rows: list[CurveRow]) -> None:
        """Send every page rows of the table, with the state."""
        self._tell({"kind": "rows", "rows": row_messages(self.desk.folder, rows), **self._state()["state"]})

    async def _refit_many(self, curves: list[tuple[CurveReader, Curve]]) -> None:
        """Fit curves, then add to the history one command for all, or, where some are left, one for each curve."""
        refit = asyncio.ensure_future(self._refits.fit(curves))
        await asyncio.sleep(0)  # so that it runs
        self._tell(self._state())
        with self._reported_errors():
            await refit
            if self._refits.cancelled or self.desk.left():
                for name in self._refitted:
                    self.desk.note(one_curve(name))
            else:
                self.desk.note(Action("fit"))
            self.desk.compact()
        self._tell(self._state())

    def _report_change(self, action: Action, curves: list[str] | None = None) -> None:
        """Send every page the rows that an action has changed (None: the folder), and the command of the action."""
        if curves is None:
            self._tell(self._folder())
        else:
            self._tell_rows([row for name in curves for row in self.desk.folder.rows_of(name)])
        self._tell({"kind": "done", "command": action.text_for(str(self.desk.path))})

    def _folder(self) -> Mapping[str, Any]:
        """Return the message with the folder and the state."""
        return {**folder_message(self.desk), "read_only": self.read_only, "state": self._state()["state"]}

    def _state(self) -> dict[str, Any]:
        """Return the message with the progress of a refit, and the change that can be undone."""
        state = {"running": self._refits.running, "done": self._refits.done, "count": self._refits.count}
        latest = self.desk.latest
        return {"kind": "state", "state": {**state, "undo": latest.text if latest else ""}}

    def _tell(self, message: Mapping[str, Any]) -> None:
        """Send every page a message."""
        broadcast(self._pages, pack(message).decode())

    def _send(self, page: ServerConnection, message: Mapping[str, Any] | bytes) -> None:
        """Send one page a message, or packed rows."""
        broadcast([page], message if isinstance(message, bytes) else pack(message).decode())
