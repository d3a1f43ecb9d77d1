"""Formulas as docstrings write them, such as ``F = 2 E/(1 - nu^2) A(d)``, as LaTeX: for the reference pages.

A formula is found by reading on from where one may begin for as long as the grammar below holds; what has neither a
relation nor an operator is a word. So prose stays prose, and nothing has to be marked.

    relation: sum (("=" | "<=" | ">=" | "<" | ">") sum)*         sum: term (("+" | "-") term)*
    term: factor (factor | "/" factor)*                          factor: ["-"] atom ["^" atom]
    atom: number | name | function atom | function "(" sum ")" | "(" sum ")" | "[" sum "]"
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

_GREEK = {
    "alpha",
    "beta",
    "gamma",
    "delta",
    "epsilon",
    "eta",
    "kappa",
    "lambda",
    "mu",
    "nu",
    "omega",
    "phi",
    "pi",
    "rho",
}
_GREEK |= {"sigma", "tau", "theta", "xi"}
_FUNCTIONS = {"sin": r"\sin", "cos": r"\cos", "tan": r"\tan", "ln": r"\ln", "exp": r"\exp", "Gamma": r"\Gamma"}
_FUNCTIONS |= {"atan": r"\arctan", "acos": r"\arccos", "asin": r"\arcsin", "max": r"\max", "min": r"\min"}
_WORDS = {"amplitude", "bias", "depth", "drift", "height", "noise", "reading", "slope"}
_LETTERS = set("abcdefghklmnpqrstuvwxyzABCDEFGHKLMPQRSTUVWXYZ")  # i, j, I, J and O only as indices; N is a unit
_CALLED = set("aAcfFguzw")  # letters that a parenthesis may make a function of
_TOKEN = re.compile(
    r"(?P<space>\s+)|(?P<number>\d+(?:\.\d+)?(?:e-?\d+)?)|(?P<name>[A-Za-z]+\d?(?:_[A-Za-z0-9]+)?\*?(?='|(?![A-Za-z_])))"
    r"|(?P<prime>'+)|(?P<sign><=|>=|[-+/^=<>()\[\],])"
)
_RELATIONS = {"=": "=", "<=": r"\le", ">=": r"\ge", "<": "<", ">": ">"}
# Code between backticks, units such as [N s/m], and a product: no formulas.
_CODE = re.compile(r"(`+).*?\1|\[[A-Z][A-Za-z]*(?:[ */^][A-Za-z0-9-]+)*\]|Net F/T", re.DOTALL)
_BEGIN = re.compile(r"(?<![\w.`^/'\])-])[A-Za-z0-9(\[]|(?<=\s)-(?=[A-Za-z])")


class _NoFormulaError(Exception):
    """Here the grammar ends."""


@dataclass
class _Reader:
    text: str
    at: int
    tokens: list[tuple[str, str, int]] = field(default_factory=list)  # kind, text, end
    next: int = 0
    shaped: bool = False  # whether there is a relation, a power, a fraction, a call or a derivative
    related: bool = False

    def peek(self) -> tuple[str, str, int]:
        while self.next >= len(self.tokens):
            at = self.tokens[-1][2] if self.tokens else self.at
            match = _TOKEN.match(self.text, at)
            while match and match.lastgroup == "space":
                at = match.end()
                match = _TOKEN.match(self.text, at)
            if match is None or match.lastgroup is None:
                return ("end", "", at)
            self.tokens.append((match.lastgroup, match[0], match.end()))
        return self.tokens[self.next]

    @property
    def end(self) -> int:
        return self.tokens[self.next - 1][2] if self.next else self.at

    def take(self) -> str:
        text = self.peek()[1]
        self.next += 1
        return text

    def attempt(self, rule: Callable[[], str]) -> str | None:
        """What a rule reads; None, with nothing taken, where it does not hold."""
        before = self.next, self.shaped, self.related
        try:
            return rule()
        except _NoFormulaError:
            self.next, self.shaped, self.related = before
            return None

    def expect(self, sign: str) -> None:
        if self.take() != sign:
            raise _NoFormulaError

    def relation(self) -> str:
        found = self.sum()
        while self.peek()[1] in _RELATIONS:

            def right() -> str:
                sign = _RELATIONS[self.take()]
                return f" {sign} {self.sum()}"

            if (more := self.attempt(right)) is None:
                break
            found, self.shaped, self.related = found + more, True, True
        return found

    def sum(self) -> str:
        found = self.term()
        while self.peek()[1] in ("+", "-"):
            if (more := self.attempt(lambda: f" {self.take()} {self.term()}")) is None:
                break
            found += more
        return found

    def term(self) -> str:
        done, factors = "", [self.factor()]
        while True:
            if self.peek()[1] == "/":
                divisor = self.attempt(lambda: (self.take(), self.factor())[1])
                if divisor is None:
                    break
                self.shaped = True
                above = _bare(factors[0]) if len(factors) == 1 else r"\,".join(factors)
                done, factors = (
                    rf"{done}\,\frac{{{above}}}{{{_bare(divisor)}}}" if done else _fraction(above, divisor),
                    [],
                )
                continue
            more = self.attempt(self.factor) if self.peek()[0] in ("number", "name") or self.peek()[1] in "([" else None
            if more is None:
                break
            factors.append(more)
        return r"\,".join(filter(None, [done, *factors]))

    def factor(self) -> str:
        if self.peek()[1] == "-":
            self.take()
            return f"-{self.factor()}"
        found = self.atom()
        if self.peek()[1] == "^":
            power = self.attempt(lambda: (self.take(), self.factor())[1])
            if power is None:
                return found
            self.shaped = True
            base = f"{{{found}}}" if found.endswith("^{*}") else found
            return f"{base}^{{{_bare(power)}}}"
        return found

    def atom(self) -> str:
        kind, text, _ = self.peek()
        if kind == "number":
            self.take()
            digits, _, power = text.partition("e")
            return text if not power else (rf"10^{{{power}}}" if digits == "1" else rf"{digits} \cdot 10^{{{power}}}")
        if text in ("(", "["):
            self.take()
            inner = self.relation()
            self.expect(")" if text == "(" else "]")
            if re.fullmatch(r"\\frac\{\d+\}\{\d+\}", inner):
                return inner
            left, right = ("(", ")") if text == "(" else ("[", "]")
            return rf"\left{left}{inner}\right{right}"
        if kind != "name":
            raise _NoFormulaError
        return self.named(text)

    def named(self, text: str) -> str:
        self.take()
        if text == "sqrt" and self.peek()[1] == "(":
            self.shaped = True
            return rf"\sqrt{{{_bare(self.atom())}}}"
        if text in _FUNCTIONS:
            self.shaped = True
            return f"{_FUNCTIONS[text]} {self.arguments() if self.peek()[1] == '(' else self.atom()}"
        found = _symbol(text)
        self.shaped |= "_" in text or text.endswith("*")
        if self.peek()[0] == "prime":
            found, self.shaped = _dotted(found, text, len(self.take())), True
        if self.peek()[1] == "(" and _adjoins(self.text, self.end) and _callable(text):
            called = self.attempt(self.arguments)
            if called is not None:
                self.shaped = True
                return f"{found}{called}"
        return found

    def arguments(self) -> str:
        self.expect("(")
        inner = [self.sum()]
        while self.peek()[1] == ",":
            self.take()
            inner.append(self.sum())
        self.expect(")")
        return rf"\left({', '.join(inner)}\right)"


def _adjoins(text: str, at: int) -> bool:
    return text[at : at + 1] == "("


def _callable(name: str) -> bool:
    head = name.partition("_")[0]
    return head in _CALLED or head in _WORDS or head in ("phi",)


def _bare(latex: str) -> str:
    """Without the parentheses that a fraction, a root or a power makes superfluous."""
    if latex.startswith(r"\left(") and latex.endswith(r"\right)") and latex.count(r"\left") == 1:
        return latex[6:-7]
    if latex.startswith(r"\left(") and latex.endswith(r"\right)"):
        depth = 0
        for match in re.finditer(r"\\left|\\right", latex):
            depth += 1 if match[0] == r"\left" else -1
            if depth == 0:
                return latex[6:-7] if match.end() == len(latex) - 1 else latex
    return latex


def _fraction(above: str, below: str) -> str:
    return rf"\frac{{{_bare(above)}}}{{{_bare(below)}}}"


def _dotted(latex: str, name: str, primes: int) -> str:
    """A derivative by time; of f by its argument."""
    return latex + "'" * primes if name == "f" else rf"\{'d' * primes}ot{{{latex}}}"


def _symbol(name: str) -> str:
    star = "^{*}" if name.endswith("*") else ""
    name = name.removesuffix("*")
    head, _, index = name.partition("_")
    if (match := re.fullmatch(r"([A-Za-z])(\d)", head)) and not index:
        head, index = match[1], match[2]
    if head in _GREEK:
        shown = rf"\{head}"
    elif head == "sum" and index:
        return rf"\sum_{index}"
    elif head in _WORDS:
        shown = rf"\mathrm{{{head}}}"
    elif len(head) == 1 and head in _LETTERS:
        shown = head
    elif len(head) == 2 and head[0] == "d" and head[1] in _LETTERS:
        shown = rf"\mathrm{{d}}{head[1]}"
    else:
        raise _NoFormulaError
    if not index:
        return shown + star
    low = index if len(index) == 1 else rf"\mathrm{{{index}}}"
    return f"{shown}_{{{low}}}{star}"


def latex_of(text: str) -> str | None:
    """A formula as LaTeX; None where the text as a whole is not one."""
    reader = _Reader(text, 0)
    found = reader.attempt(reader.relation)
    return found if found is not None and reader.end == len(text.rstrip()) else None


def with_math(text: str) -> str:
    """Prose in which every formula is ``$LaTeX$``; code between backticks stays as it is."""
    made, at = [], 0
    for code in (*_CODE.finditer(text), None):
        until = code.start() if code else len(text)
        made.append(_prose(text[at:until]))
        if code:
            made.append(code[0] if code[1] else _escaped(code[0]))
            at = code.end()
    return "".join(made)


def _prose(text: str) -> str:
    made, at = [], 0
    while (begin := _BEGIN.search(text, at)) is not None:
        reader = _Reader(text, begin.start())
        found = reader.attempt(reader.relation)
        if found is None or not reader.shaped or (text[begin.start()] == "[" and not reader.related):
            word = re.compile(r"[\w']*[^\w]?").match(text, begin.start())
            stop = max(word.end() if word else 0, begin.start() + 1)
            made.append(_escaped(text[at:stop]))
            at = stop
            continue
        made.append(f"{_escaped(text[at : begin.start()])}${found}$")
        at = reader.end
    return "".join(made) + _escaped(text[at:])


def _escaped(text: str) -> str:
    return re.sub(r"([\\*_<>$|\[\]])", r"\\\1", text)
