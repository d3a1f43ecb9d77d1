"""The server of the page: browsers in, answers out; the folder is the only truth, and every page gets each change."""

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
from palpate_kit.page.datagrams import pack, pack_rows
from palpate_kit.page.gate import GREETING, GuardedConnection, answer_request, page_files
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from palpate_desk import page_messages as asked
from palpate_desk.action import Action
from palpate_desk.curve_answers import CurveAnswer, curve_answer, reader_with_model
from palpate_desk.desk import Desk, one_curve
from palpate_desk.fact_form import fact_mistakes, facts_message, open_facts_of
from palpate_desk.folder_view import exported, folder_message, row_messages
from palpate_desk.refits import Refits, Worker

_PAGES = 16
_KEPT = 64  # curves whose samples are kept
_LOOK = 1.0  # [s] between two looks at the files
_DRAIN = 1.0  # [s] for browsers to take what is left
_FILES = page_files(
    "palpate_desk",
    ("index.html", "desk.css", "main.js", "facts.js", "table.js", "curve.js", "points.js", "keys.js"),
)


class DeskServer:
    """Pages of one desk."""

    def __init__(self, desk: Desk, read_only: bool, workers: int | None) -> None:
        self.desk, self.read_only = desk, read_only
        self.token = secrets.token_urlsafe(16)
        self._pages: dict[ServerConnection, asked.CurveQuestion | None] = {}
        self._kept: OrderedDict[tuple[str, str], CurveAnswer] = OrderedDict()
        self._worker = Worker()
        self._refits = Refits(self._worker, self._take, workers)
        self._tasks = set[asyncio.Task[None]]()
        self._noted: list[str] = []  # curves of a refit of all
        self._orders: dict[type, Callable[[Any], None]] = {
            asked.MarkOrder: lambda m: self._changed(desk.mark(m.curve, m.mark, m.reason), [m.curve]),
            asked.SetOrder: lambda m: self._changed(desk.set(m.assignment, m.where)),
            asked.TipOrder: lambda m: self._changed(desk.set_part(m.do, m.value)),
        }

    async def run(self, listener: socket.socket) -> None:
        """Serve until cancelled."""
        silent = logging.getLogger("palpate_desk")
        silent.disabled = True
        async with serve(
            self._serve, sock=listener, process_request=self._admit, compression=None, logger=silent,
            max_size=asked.LARGEST, server_header=None, open_timeout=GREETING, close_timeout=_DRAIN,
            create_connection=GuardedConnection,
        ):  # fmt: skip
            try:
                await self._watch()
            finally:
                self._refits.cancel()
                self._tell({"kind": "over"})
                self._worker.close()
                if not self.read_only:
                    self.desk.compact()

    async def _watch(self) -> None:
        """Look at the files from time to time: another program may change them."""
        while True:
            await asyncio.sleep(_LOOK)
            with self._telling():
                if self.desk.changed_outside and not self._refits.running:
                    self.desk.reload()
                    self._tell(self._folder())
                    self._tell({"kind": "note", "text": "another program has changed files of the folder"})

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        return answer_request(request, self.token, _FILES)

    async def _serve(self, page: ServerConnection) -> None:
        if len(self._pages) >= _PAGES:
            await page.close(1013, "too many pages are open")
            return
        self._pages[page] = None
        has_folder = False
        with self._telling(page):
            self._send(page, self._folder())
            has_folder = True
        if not has_folder:  # it is sent once the folder can be read again, however soon that is
            self.desk.forget()
        looking = asyncio.create_task(self._look(page, wake := asyncio.Event()))
        with contextlib.suppress(ConnectionClosed):
            async for text in page:
                await self._answer(page, text, wake)
        looking.cancel()
        self._pages.pop(page, None)

    @contextlib.contextmanager
    def _telling(self, page: ServerConnection | None = None) -> Iterator[None]:
        """Within the context an error becomes a message to a page, or to all: what one asks for ends no connection."""
        try:
            yield
        except Exception as error:
            message = {"kind": "error", "text": error_text(error)}
            self._tell(message) if page is None else self._send(page, message)

    async def _answer(self, page: ServerConnection, text: str | bytes, wake: asyncio.Event) -> None:
        with self._telling(page):
            message = asked.read_message(text)
            if self.read_only and not isinstance(message, asked.READING):
                raise ConfigurationError("the page was opened with --read-only")
            if isinstance(message, asked.CurveQuestion):
                self._pages[page] = message  # the latest one wins
                wake.set()
            elif isinstance(message, asked.FilterQuestion):
                names = self.desk.chosen(message.words)
                self._send(page, {"kind": "filter", "words": message.words, "names": names})
            elif isinstance(message, asked.RefitOrder):
                await self._refit(page, message)
            elif isinstance(message, asked.FactsQuestion):
                self._send(page, facts_message(self.desk, await open_facts_of(self.desk, self._fitted), message.curve))
            elif isinstance(message, asked.FactsOrder):
                self._state_facts(page, message)
            elif isinstance(message, asked.CompareQuestion):
                await self._compare(page, message)
            elif isinstance(message, asked.GroupsQuestion | asked.ExportOrder):
                self._send(page, await exported(self.desk, message))
                if isinstance(message, asked.ExportOrder):
                    self._tell(self._state())
            else:
                self._orders[type(message)](message)

    def _state_facts(self, page: ServerConnection, message: asked.FactsOrder) -> None:
        """Write what was answered, and fit what that concerns; mistakes are shown at their fields, all at once."""
        self._demand_idle()
        mistakes = fact_mistakes(message.answers)
        if not mistakes:
            try:
                self._changed(self.desk.state_facts(message.answers))
            except UserError as error:  # facts that do not go together
                mistakes = {"": str(error)}
        self._send(page, {"kind": "mistakes", "mistakes": mistakes})
        if not mistakes:
            self._refit_all()

    def _demand_idle(self) -> None:
        if self._refits.running:
            raise ConfigurationError("curves are being fitted; cancel that first")

    async def _compare(self, page: ServerConnection, message: asked.CompareQuestion) -> None:
        """Models weighed on a curve, with the force of the second one."""
        weighed = await exported(self.desk, message)
        reader = reader_with_model(self.desk.reader(message.curve), message.model)
        second = await self._worked(reader, self.desk.curve(message.curve), True)
        header = {**weighed, "curve": message.curve, "model": message.model, "error": second.error}
        self._send(page, pack_rows(header, second.time, second.columns))

    async def _refit(self, page: ServerConnection, message: asked.RefitOrder) -> None:
        if message.do == "undo":
            self._changed(self.desk.undo())
        elif message.do == "cancel":
            self._refits.cancel()
        elif message.do == "refit":
            self.desk.demand_file(message.curve)
            answer = await self._fitted(message.curve)
            self.desk.note(one_curve(message.curve))
            self._took(answer.rows)
            self._draw(page, answer, 0)
        else:
            self._refit_all()

    def _refit_all(self) -> None:
        self._demand_idle()
        curves = [self.desk.curve(name) for name in self.desk.left()]
        if not curves:
            raise ConfigurationError("every curve is fitted with the present settings")
        self._noted = []
        task = asyncio.create_task(self._refit_many([(self.desk.reader(curve.name), curve) for curve in curves]))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _look(self, page: ServerConnection, wake: asyncio.Event) -> None:
        """Answer a page's latest question; what is overtaken before it begins is not computed."""
        while True:
            await wake.wait()
            wake.clear()
            question = self._pages[page]
            if question is None:
                continue
            with self._telling(page):  # one curve that breaks a part does not keep the others from the page
                answer = await self._curve(question.curve)
                if not answer.settings and not self._is_left(question.curve):
                    answer = await self._curve(question.curve)  # it was fitted meanwhile
                if self._pages.get(page) is question:  # a late answer is dropped
                    self._draw(page, answer, question.number)

    async def _curve(self, name: str) -> CurveAnswer:
        """Return a curve as its row has it: modelled where the row is current, else as it was read."""
        key = self.desk.folder.key(self.desk.curve(name).name)
        current = not self._is_left(name)
        if (known := self._kept.get((name, key if current else ""))) is not None:
            self._kept.move_to_end((name, known.settings))
            return known
        return await self._fitted(name) if current else await self._computed(name, False)

    def _is_left(self, name: str) -> bool:
        """Return True if a curve has no row by its present settings."""
        return any(row.state != "current" for row in self.desk.folder.rows_of(name))

    async def _fitted(self, name: str) -> CurveAnswer:
        return await self._computed(name, True)

    async def _computed(self, name: str, fitting: bool) -> CurveAnswer:
        answer = await self._worked(self.desk.reader(name), self.desk.curve(name), fitting)
        self._kept[name, answer.settings] = answer
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return answer

    async def _worked(self, reader: CurveReader, curve: Curve, fitting: bool) -> CurveAnswer:
        try:
            return await self._worker.call(curve_answer, reader, curve, fitting)
        except BrokenProcessPool as error:
            raise OutputError(f"{curve.name}: the process that fitted it was killed: is the memory enough?") from error

    def _draw(self, page: ServerConnection, answer: CurveAnswer, number: int) -> None:
        header = {
            "kind": "curve", "curve": answer.curve, "number": number, "error": answer.error, **answer.facts,
            "columns": ["height", "force", "model"],
        }  # fmt: skip
        self._send(page, pack_rows(header, answer.time, answer.columns))

    def _take(self, rows: list[Row]) -> None:
        """Rows of a refit of all."""
        self._noted.append(rows[0]["curve"])
        self._took(rows)

    def _took(self, rows: list[Row]) -> None:
        name = rows[0]["curve"]
        if rows[0]["settings"] != self.desk.folder.key(name):
            return  # its settings have changed since it began
        try:
            found = self.desk.take_rows(rows)
        except UserError as error:  # the disk is full
            self._refits.cancel()
            self._tell({"kind": "error", "text": str(error)})
            return
        self._tell({"kind": "rows", "rows": row_messages(self.desk.folder, found), **self._state()["state"]})

    async def _refit_many(self, curves: list[tuple[CurveReader, Curve]]) -> None:
        """Fit curves, and write into the history what was done."""
        fitting = asyncio.ensure_future(self._refits.fit(curves))
        await asyncio.sleep(0)
        self._tell(self._state())
        with self._telling():
            await fitting
            if self._refits.cancelled or self.desk.left():
                for name in self._noted:
                    self.desk.note(one_curve(name))
            else:
                self.desk.note(Action("fit"))
            self.desk.compact()
        self._tell(self._state())

    def _changed(self, action: Action, curves: list[str] | None = None) -> None:
        """Send every page what has changed by an action."""
        if curves is None:
            self._tell(self._folder())
        else:
            rows = [row for name in curves for row in self.desk.folder.rows_of(name)]
            self._tell({"kind": "rows", "rows": row_messages(self.desk.folder, rows), **self._state()["state"]})
        self._tell({"kind": "done", "command": action.text_for(str(self.desk.path))})

    def _folder(self) -> Mapping[str, Any]:
        return {**folder_message(self.desk), "read_only": self.read_only, "state": self._state()["state"]}

    def _state(self) -> dict[str, Any]:
        state = {"running": self._refits.running, "done": self._refits.done, "count": self._refits.count}
        latest = self.desk.latest
        return {"kind": "state", "state": {**state, "undo": latest.text if latest else ""}}

    def _tell(self, message: Mapping[str, Any]) -> None:
        broadcast(self._pages, pack(message).decode())

    def _send(self, page: ServerConnection, message: Mapping[str, Any] | bytes) -> None:
        broadcast([page], message if isinstance(message, bytes) else pack(message).decode())
