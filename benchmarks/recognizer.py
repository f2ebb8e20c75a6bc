"""Train the recognizer of requests, or count the sentences of other authors that are understood.

    python benchmarks/recognizer.py --out python/gensim2/instructions/recognizer
    python benchmarks/recognizer.py --leave-out writer_1 --leave-out writer_4
    python benchmarks/recognizer.py --authors

Each file in ``requests/`` is of one writer: requests for the joint goals of the library, and sentences that ask for
nothing that the robot can do. The writers, a language model in different roles, knew only the joint goals. The authors'
sentences are in ``tests/instructions`` and train nothing. Training takes a few minutes of CPU time.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from gensim2.core.yaml_files import read_yaml
from gensim2.instructions.grammar import by_grammar, parse
from gensim2.instructions.meanings import solved
from gensim2.instructions.recognition import Head, Recognizer, Request, tokens_of
from gensim2.instructions.steps import MoveJoint, SentenceError, Step
from gensim2.objects.words import noun

REQUESTS = Path(__file__).parent / "requests"
_TESTS = Path(__file__).parents[1] / "tests" / "instructions"
AUTHORS = [_TESTS / "other_people.yaml", *sorted(_TESTS.glob("author_*.yaml"))]
EPOCHS, BATCH, RATE = 14, 64, 2e-3
DROPPED = 0.15
"""Fraction of the tokens that training hides at random."""
SMOOTHING = 0.05

Steps = tuple[Step, ...]


@dataclass(frozen=True)
class Sentence:
    """A sentence of a writer, and the request that it makes; None if it makes none."""

    text: str
    request: Request | None


def requests() -> dict[str, Request]:
    """Return the requests by the texts of their steps."""
    actions: dict[str, int] = {}
    nouns: dict[str, int] = {}
    found = {}
    for step in solved():
        action = actions.setdefault(_action(step), len(actions))
        found[step.text] = Request(
            asset_class=step.asset_class,
            goal=step.goal,
            action=action,
            noun=nouns.setdefault(noun(step.asset_class), len(nouns)),
        )
    return found


def _action(step: MoveJoint) -> str:
    """Return the text of a step with a placeholder for the noun. Texts for the same action become equal."""
    text = step.text.replace(noun(step.asset_class), "X").replace("light X", "X")
    text = text.partition(" to let")[0].partition(" for a")[0].replace(" but leave it ajar", " halfway")
    return "close the X halfway" if text.startswith("leave the door of") else text


def sentences(writer: Path, known: dict[str, Request]) -> list[Sentence]:
    """Return the sentences of a writer."""
    data = read_yaml(writer)
    found = [Sentence(text, known[job]) for job, texts in data["jobs"].items() for text in texts]
    return [*found, *(Sentence(text, None) for text in data["none"])]


def train(data: Sequence[Sentence], known: Sequence[Request], seed: int = 0) -> Recognizer:
    """Train the head."""
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    none = 1 + max(each.action for each in known)
    head = Head(none, 1 + max(each.noun for each in known))
    ordered = sorted(data, key=lambda each: len(each.text))  # sentences of a batch have similar lengths
    batches = []
    for start in range(0, len(ordered), BATCH):
        rows = ordered[start : start + BATCH]
        actions = torch.tensor([none if each.request is None else each.request.action for each in rows])
        nouns = torch.tensor([0 if each.request is None else each.request.noun for each in rows])
        batches.append((*tokens_of([each.text for each in rows]), actions, nouns))
    optimizer = torch.optim.AdamW(head.parameters(), RATE, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=EPOCHS * len(batches))
    loss = nn.CrossEntropyLoss(label_smoothing=SMOOTHING)
    for epoch in range(EPOCHS):
        for number in torch.randperm(len(batches), generator=generator).tolist():
            tokens, mask, actions, nouns = batches[number]
            kept = mask & (torch.rand(mask.shape, generator=generator) > DROPPED)
            kept[:, 0] = True
            by_action, by_noun = head(nn.functional.dropout(tokens, 0.1), kept)
            makes = actions != none
            error = loss(by_action, actions) + loss(by_noun[makes], nouns[makes])
            optimizer.zero_grad()
            error.backward()
            optimizer.step()
            schedule.step()
        print(f"epoch {epoch + 1} of {EPOCHS}: loss {error.item():.3f}", flush=True)
    return Recognizer(head.eval(), known)


def count(recognizer: Recognizer, data: Sequence[Sentence]) -> str:
    """Return the numbers of right and wrong answers of the recognizer as a line of text."""
    found = recognizer.recognize([each.text for each in data])
    return _counted(
        ((each.request.step,) if each.request else None, (answer.step,) if answer.is_request else None)
        for each, answer in zip(data, found, strict=True)
    )


def of_authors() -> list[str]:
    """Return a line for each author: numbers of sentences that the grammar alone and the whole parser understand."""
    lines = []
    for path in AUTHORS:
        data = read_yaml(path)
        meant = [(by_grammar(job), text) for job, texts in data["paraphrases"].items() for text in texts]
        others = [(None, text) for text in data["unrelated"]]
        for name, reader in (("grammar", by_grammar), ("parser", parse)):
            counted = _counted((steps, _steps(reader, text)) for steps, text in [*meant, *others])
            lines.append(f"{path.stem} {name}: {counted}")
    return lines


def _counted(pairs: Iterable[tuple[Steps | None, Steps | None]]) -> str:
    """Return the numbers of right and wrong answers as a line of text.

    Args:
        pairs: steps that a sentence asks for, and steps that were understood; None stands for no request.
    """
    pairs = list(pairs)
    made = [(meant, found) for meant, found in pairs if meant is not None]
    acted = sum(meant is None and found is not None for meant, found in pairs)
    right = sum(found == meant for meant, found in made)
    wrong = sum(found is not None and found != meant for meant, found in made)
    return (
        f"{right} of {len(made)} understood, {wrong} in another sense; "
        f"{acted} of {len(pairs) - len(made)} other sentences not refused"
    )


def _steps(reader: Callable[[str], Steps], sentence: str) -> Steps | None:
    try:
        return reader(sentence)
    except SentenceError:
        return None


def main() -> None:
    """Parse the command line, and train."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--leave-out", action="append", default=[], metavar="WRITER", help="count this writer's sentences"
    )
    parser.add_argument("--out", type=Path, help="folder for the weights")
    parser.add_argument("--authors", action="store_true", help="train nothing; count the authors' sentences")
    given = parser.parse_args()
    if given.authors:
        print(*of_authors(), sep="\n")
        return
    known = requests()
    data = {path.stem: sentences(path, known) for path in sorted(REQUESTS.glob("*.yaml"))}
    if missing := set(given.leave_out) - set(data):
        parser.error(f"no writer {', '.join(sorted(missing))} in {REQUESTS}")
    used = [each for writer, texts in data.items() if writer not in given.leave_out for each in texts]
    recognizer = train(used, list(known.values()))
    for writer in given.leave_out:
        print(f"{writer}: {count(recognizer, data[writer])}")
    if given.out is not None:
        recognizer.save(given.out)


if __name__ == "__main__":
    main()
