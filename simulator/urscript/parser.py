"""From the text of a script to its syntax tree.

Source of the language: Universal Robots, "The URScript Programming Language"; what is understood is in
docs/simulator.md. Errors have the form that the controller itself reports.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from simulator.program import ProgramError
from simulator.urscript.nodes import (
    Assignment,
    Branches,
    Call,
    Critical,
    Function,
    Index,
    Items,
    Jump,
    Literal,
    Name,
    Node,
    Numbers,
    Operation,
    Place,
    ThreadCommand,
    While,
)

DEPTH_MAX = 40  # nested brackets and blocks; a deeper text is no program
LEVELS = (  # operators from the loosest to the tightest
    ("or", "xor"),
    ("and",),
    ("==", "!=", "<", "<=", ">", ">="),
    ("+", "-"),
    ("*", "/", "%"),
)
NOT_LEVEL = 2  # `not` binds tighter than `and`, looser than a comparison
CONSTANTS = {"True": True, "False": False, "true": True, "false": False}
BLOCK_WORDS = frozenset({"def", "sec", "thread", "if", "while"})
BLOCK_ENDS = frozenset({"end", "elif", "else"})
JUMPS = frozenset({"return", "break", "continue", "halt", "pass"})
CRITICAL = {"enter_critical": True, "exit_critical": False}
CONTINUING = frozenset({"or", "and", "xor", "not"})  # a line that ends with one goes on in the next
WORDS = (
    BLOCK_WORDS
    | BLOCK_ENDS
    | JUMPS
    | CRITICAL.keys()
    | {"global", "local", "run", "kill", "join", "not", "and", "or", "xor"}
)
NUMBER = r"(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)"
SIGNED = f"[ \\t]*-?{NUMBER}[ \\t]*"
# A list of plain numbers is one token: programs that carry a motion have thousands of them.
TOKEN = re.compile(
    rf"(?P<space>[ \t\r]+|#[^\n]*)|(?P<newline>\n)|(?P<number>{NUMBER})"
    rf"|(?P<numbers>(?<![\w\])])\[{SIGNED}(?:,{SIGNED})*\])"
    r'|(?P<text>"[^"\n]*"|\'[^\'\n]*\')|(?P<word>[A-Za-z_]\w*)|(?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:.])'
)


class Token(NamedTuple):
    """A token: its kind (number, numbers, text, word, sign, newline, end), its text and its place."""

    kind: str
    text: str
    place: Place


def tokens_of(text: str) -> list[Token]:
    """Returns the tokens of a text; a newline within brackets, or after `or` and its like, is none.

    Raises:
        ProgramError: a character that no token begins with.
    """
    found: list[Token] = []
    at = 0
    line = 1
    begin = 0
    depth = 0
    while at < len(text):
        match = TOKEN.match(text, at)
        place = Place(line, at - begin + 1)
        if match is None:
            raise syntax_error(text, place)
        kind = str(match.lastgroup)
        word = match.group()
        at = match.end()
        if kind == "newline":
            line = line + 1
            begin = at
        depth += (word in "([") - (word in ")]") if kind == "sign" else 0
        continues = depth > 0 or (bool(found) and found[-1].kind == "word" and found[-1].text in CONTINUING)
        if kind != "space" and not (kind == "newline" and continues):
            found.append(Token(kind, word, place))
    found.append(Token("end", "", Place(line, 1)))
    return found


def syntax_error(text: str, place: Place) -> ProgramError:
    """Returns the error of a line that is none of the language, in the controller's words."""
    lines = text.split("\n")
    line = lines[place.line - 1] if place.line <= len(lines) else ""
    return ProgramError(f"syntax_error_on_line:{place.line}:{line}:", place.line, place.column)


def parse(text: str, one_line: bool = False) -> tuple[Node, ...]:
    """Returns the statements of a text, one a line; with `one_line` they may follow one another on a line.

    Raises:
        ProgramError: the text is no script; with the line.
    """
    parser = _Parser(text, one_line)
    block = parser.block(())
    if parser.now.kind != "end":
        raise syntax_error(text, parser.now.place)
    return block


def _value(text: str) -> float:
    return float(text) if "." in text or "e" in text.lower() else int(text)


class _Parser:
    """Recursive descent over the tokens."""

    def __init__(self, text: str, one_line: bool) -> None:
        self.text = text
        self.tokens = tokens_of(text)
        self.one_line = one_line
        self.at = 0
        self.depth = 0

    @property
    def now(self) -> Token:
        return self.tokens[self.at]

    def take(self) -> Token:
        token = self.now
        self.at += token.kind != "end"
        return token

    def accept(self, *words: str) -> bool:
        """Takes the next token if it is one of these words or signs; returns whether it was."""
        found = self.now.kind in ("word", "sign") and self.now.text in words
        self.at += found
        return found

    def expect(self, *words: str) -> None:
        if not self.accept(*words):
            raise self.error()

    def error(self) -> ProgramError:
        return syntax_error(self.text, self.now.place)

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > DEPTH_MAX:
            raise self.error()

    # -- statements
    def block(self, ends: tuple[str, ...]) -> tuple[Node, ...]:
        """Returns the statements up to one of these words, which is left, or up to the end of the text."""
        self.deeper()
        found: list[Node] = []
        while True:
            while self.now.kind == "newline":
                self.take()
            if self.now.kind == "end" or (self.now.kind == "word" and self.now.text in ends):
                self.depth -= 1
                return tuple(found)
            found.append(self.statement())
            ended = self.now.kind in ("newline", "end") or self.now.text in BLOCK_ENDS
            if not ended and not self.one_line:
                raise self.error()

    def statement(self) -> Node:
        word = self.now.text if self.now.kind == "word" else ""
        place = self.now.place
        if word in BLOCK_WORDS:
            self.take()
            return self.compound(word, place)
        if word in JUMPS:
            self.take()
            has_value = word == "return" and self.now.kind not in ("newline", "end")
            return Jump(place, word, self.expression() if has_value else None)
        if word in CRITICAL:
            self.take()
            return Critical(place, CRITICAL[word])
        if word in ("kill", "join"):
            self.take()
            return ThreadCommand(place, word, self.expression())
        return self.assignment(place)

    def assignment(self, place: Place) -> Node:
        scope = self.take().text if self.now.text in ("global", "local") else ""
        target = self.expression()
        if not self.accept("="):
            if scope:
                raise self.error()
            return target
        if not isinstance(target, Name | Index):
            raise self.error()
        return Assignment(place, target, self.expression(), scope)

    def compound(self, word: str, place: Place) -> Node:
        if word == "if":
            return self.branches(place)
        if word == "while":
            condition = self.condition()
            return While(place, condition, self.ended_block())
        return self.function(word, place)

    def function(self, kind: str, place: Place) -> Node:
        name = self.identifier()
        parameters: list[str] = []
        defaults: list[Node] = []
        self.expect("(")
        while not self.accept(")"):
            parameters.append(self.identifier())
            if self.accept("="):
                defaults.append(self.expression())
            elif defaults:  # one without a default follows one with
                raise self.error()
            if self.now.text != ")":
                self.expect(",")
        self.expect(":")
        return Function(place, kind, name, tuple(parameters), tuple(defaults), self.ended_block())

    def branches(self, place: Place) -> Node:
        found: list[tuple[Node | None, tuple[Node, ...]]] = [(self.condition(), self.block(("elif", "else", "end")))]
        while self.accept("elif"):
            found.append((self.condition(), self.block(("elif", "else", "end"))))
        if self.accept("else"):
            self.expect(":")
            found.append((None, self.block(("end",))))
        self.expect("end")
        return Branches(place, tuple(found))

    def condition(self) -> Node:
        condition = self.expression()
        self.expect(":")
        return condition

    def ended_block(self) -> tuple[Node, ...]:
        block = self.block(("end",))
        self.expect("end")
        return block

    def identifier(self) -> str:
        if self.now.kind != "word" or self.now.text in WORDS:
            raise self.error()
        return self.take().text

    # -- expressions
    def expression(self, level: int = 0) -> Node:
        """Returns an expression of the operators of one level and all tighter ones."""
        if level == len(LEVELS):
            return self.unary()
        if level == NOT_LEVEL and self.now.kind == "word" and self.now.text == "not":
            place = self.take().place
            self.deeper()
            operand = self.expression(level)
            self.depth -= 1
            return Operation(place, "not1", (operand,))
        left = self.expression(level + 1)
        while self.now.kind in ("word", "sign") and self.now.text in LEVELS[level]:
            operator = self.take()
            left = Operation(operator.place, operator.text, (left, self.expression(level + 1)))
        return left

    def unary(self) -> Node:
        self.deeper()
        place = self.now.place
        if self.accept("-", "+"):
            operator = self.tokens[self.at - 1].text
            found: Node = Operation(place, f"{operator}1", (self.unary(),))
        else:
            found = self.indexed()
        self.depth -= 1
        return found

    def indexed(self) -> Node:
        found = self.primary()
        while self.now.text == "[" and self.now.kind == "sign":
            place = self.take().place
            found = Index(place, found, self.expression())
            self.expect("]")
        return found

    def primary(self) -> Node:
        token = self.now
        if token.kind == "number":
            self.take()
            return Literal(token.place, _value(token.text))
        if token.kind == "numbers":
            self.take()
            return Numbers(token.place, tuple(map(_value, token.text[1:-1].split(","))))
        if token.kind == "text":
            self.take()
            return Literal(token.place, token.text[1:-1])
        if self.accept("("):
            found = self.expression()
            self.expect(")")
            return found
        if self.accept("["):
            return Items(token.place, self.items("]"), False)
        return self.word(token)

    def word(self, token: Token) -> Node:
        run = self.accept("run")
        name = self.identifier()
        if self.accept("("):
            return self.call(token.place, name, run)
        if run:
            raise self.error()
        if name == "p" and self.accept("["):
            return Items(token.place, self.items("]"), True)
        return Literal(token.place, CONSTANTS[name]) if name in CONSTANTS else Name(token.place, name)

    def call(self, place: Place, name: str, run: bool) -> Node:
        arguments: list[Node] = []
        named: list[tuple[str, Node]] = []
        while not self.accept(")"):
            following = self.tokens[min(self.at + 1, len(self.tokens) - 1)]
            if self.now.kind == "word" and following.text == "=" and following.kind == "sign":
                word = self.identifier()
                self.take()
                named.append((word, self.expression()))
            else:
                arguments.append(self.expression())
            if self.now.text != ")":
                self.expect(",")
        return Call(place, name, tuple(arguments), tuple(named), run)

    def items(self, end: str) -> tuple[Node, ...]:
        found: list[Node] = []
        while not self.accept(end):
            found.append(self.expression())
            if self.now.text != end:
                self.expect(",")
        return tuple(found)
