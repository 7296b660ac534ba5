"""Questions on a terminal, and their defaults where nobody can be asked."""

from __future__ import annotations

import sys
from collections.abc import Generator
from typing import TYPE_CHECKING, TypeVar

import typer

from hydro.commands import interrupts
from hydro.commands.shell import message
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.core.guessing.interview import Question

Result = TypeVar("Result")


def asks() -> bool:
    """Return whether there is a person to ask."""
    return sys.stdin.isatty() and sys.stderr.isatty()


class Asker:
    """Whoever gives the answers: a person on a terminal, or else the defaults.

    Args:
        about: What the questions are about, for error lines.
    """

    def __init__(self, about: str) -> None:
        """Begin with question 1."""
        self._about, self._asked = about, 0

    def talk(self, questions: Generator[Question, str, Result], hint: str) -> Result:
        """Ask until the answers are known, and return what they say.

        Args:
            questions: Yields questions, and is sent the answers.
            hint: What `?` prints.

        Raises:
            UsageError: An answer has no default and there is nobody to ask, or the input has ended.
        """
        try:
            question = next(questions)
            while True:
                question = questions.send(self._answer(question, hint))
        except StopIteration as end:
            found: Result = end.value
            return found

    def _answer(self, question: Question, hint: str) -> str:
        """Return the checked answer to a question."""
        if not asks():
            if not question.default:
                raise UsageError(f"{self._about}: {question.text}: give {question.option}")
            message(
                f"hydro: {question.key}: {question.default}, the default; {question.option} says otherwise"
            )
            return question.default
        self._asked += 1
        message("")
        while True:
            text = _typed(f"{self._asked}. {question.text}", question)
            if text == "?":
                message(hint)
                continue
            try:
                question.check(text)
            except DataError as error:
                message(f"   {error}")
                continue
            return text


def _typed(text: str, question: Question) -> str:
    """Return what a person types; Enter is the default.

    Raises:
        UsageError: The input has ended.
    """
    try:
        answer = typer.prompt(
            text,
            default=question.default,
            show_default=bool(question.default),
            err=True,
            prompt_suffix=":\n> ",
        )
    except typer.Abort:
        if interrupts.seen():
            raise KeyboardInterrupt from None
        message("")
        raise UsageError(f"the answers have ended: give {question.option}") from None
    return str(answer).strip()
