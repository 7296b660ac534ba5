"""Questions to the user on a terminal; without a terminal, the questions' default answers."""

from __future__ import annotations

import signal
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
    """Return whether stdin and stderr are a terminal on which questions can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


class Asker:
    """Source of answers to questions: the user at a terminal, or else the questions' defaults.

    Args:
        about: Subject of the questions, for error lines.
    """

    def __init__(self, about: str) -> None:
        """Start with question 1."""
        self._about, self._asked = about, 0

    def talk(self, questions: Generator[Question, str, Result], hint: str) -> Result:
        """Ask the questions of a generator in turn, and return the generator's result.

        Args:
            questions: Generator that yields questions and receives answers.
            hint: Text that the answer `?` prints.

        Raises:
            UsageError: A question has no default and there is no terminal, or the input has ended.
        """
        try:
            question = next(questions)
            while True:
                question = questions.send(self._answer(question, hint))
        except StopIteration as end:
            found: Result = end.value
            return found

    def _answer(self, question: Question, hint: str) -> str:
        """Return the answer to a question, asked again until it is valid; without a terminal, its default."""
        if not asks():
            if not question.default:
                raise UsageError(f"{self._about}: {question.text}: give {question.option}")
            message(f"hydro: {question.key}: default {question.default}; change it with {question.option}")
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
    """Read an answer from the terminal; Enter gives the default.

    Raises:
        UsageError: The input has ended.
    """
    signal.siginterrupt(signal.SIGINT, True)  # pyarrow's readers let it restart a read from the terminal
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
        raise UsageError(f"the input ended before the last answer: give {question.option}") from None
    return str(answer).strip()
