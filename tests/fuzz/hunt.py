"""Inputs by their numbers, and a hunt over many inputs that shrinks and stores its findings.

``python -m tests.fuzz.hunt FIRST LAST [FOLDER]`` judges the inputs FIRST to LAST - 1 and writes the
smallest input of each new signature into FOLDER, by default `tests/data/fuzz`.
"""

import json
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

from proofmass.batch.check import LOADING_SECONDS
from tests.fuzz.cases import EDITS, TIMEOUT, Files, small_files, write_files
from tests.fuzz.judge import MARGIN_SECONDS, ROOT, Judge, Verdict
from tests.fuzz.mutators import Mutation, apply_mutations, draw_mutations

COLD_TIMEOUT = 20.0
"""Limit of a run that includes the start of its engine [s]; with a load of 12 it took 9 s."""
FINDINGS_FOLDER = ROOT / "tests" / "data" / "fuzz"


def input_by_number(number: int) -> tuple[str, list[Mutation]]:
    """The case of an input and its mutations."""
    rng = Random(number)
    name = rng.choice(list(EDITS))
    endings = [Path(file).suffix for file in dict(small_files(name))]
    return name, draw_mutations(rng, endings)


def input_files(name: str, mutations: list[Mutation]) -> Files:
    """The files of an input."""
    return apply_mutations(dict(small_files(name)), mutations)


def shrink_mutations(
    judge: Judge, name: str, mutations: list[Mutation], signature: str
) -> list[Mutation]:
    """As few of the mutations as still lead to a finding with this signature."""
    for k in reversed(range(len(mutations))):
        fewer = mutations[:k] + mutations[k + 1 :]
        if fewer and signature in judge.judge(name, input_files(name, fewer)).findings:
            mutations = fewer
    return mutations


def judge_by_command_line(files: Files, folder: Path) -> Verdict:
    """Judge an input by ``proofmass check FOLDER --json``.

    Each command starts its engines, so that runs get more time than in the judge.
    """
    limit = (
        LOADING_SECONDS + 5 * COLD_TIMEOUT + MARGIN_SECONDS
    )  # at most four runs in a small case, and the check of the case before
    write_files(
        {
            name: content.replace(
                f"timeout = {TIMEOUT}".encode(), f"timeout = {COLD_TIMEOUT}".encode()
            )
            for name, content in files.items()
        },
        folder,
    )
    answer, began = Verdict(), time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "proofmass", "check", str(folder), "--json"],
            cwd=folder,
            capture_output=True,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return Verdict(["command line: hang"], seconds=limit)
    answer.exit_code, answer.seconds = done.returncode, time.perf_counter() - began
    words = done.stderr.decode(errors="replace")
    if done.returncode not in (0, 1, 2):
        answer.findings.append(f"command line: exit code {done.returncode}")
    if "Traceback (most recent call last)" in words:
        last = [
            w for w in words.splitlines() if re.match(r"\w[\w.]*(Error|Exception|Warning)\b", w)
        ]
        kind = last[-1].split(":")[0] if last else "?"
        answer.findings.append(f"command line: traceback, {kind}")
    elif done.returncode == 2 and "error: " not in words:
        answer.findings.append("command line: exit code 2 without a line that says why")
    if not answer.findings:
        try:
            json.loads(done.stdout)
        except ValueError:
            answer.findings.append("command line: no JSON")
    answer.detail = words[-2000:]
    return answer


def store_finding(folder: Path, signature: str, name: str, files: Files) -> Path:
    """Store an input under its signature, as `open`: the finding is not repaired yet."""
    folder.mkdir(parents=True, exist_ok=True)
    slug = re.sub(r"\W+", "_", signature).strip("_")[:80]
    file = folder / f"{slug}.json"
    base = dict(small_files(name))
    changed = {k: v.decode("latin-1") for k, v in files.items() if v != base[k]}
    table = {"signature": signature, "open": True, "case": name, "changed": changed}
    file.write_text(json.dumps(table, indent=1) + "\n", encoding="ascii")
    return file


def read_finding(file: Path) -> tuple[str, Files, dict]:
    """A stored input: its case, its files, and its table with signature and `open`."""
    table = json.loads(file.read_text(encoding="ascii"))
    changed = {k: v.encode("latin-1") for k, v in table["changed"].items()}
    return table["case"], dict(small_files(table["case"])) | changed, table


def hunt(first: int, last: int, folder: Path) -> Counter[str]:
    """Judge inputs, print new findings and notes, store new findings, and count all of them."""
    known = {read_finding(file)[2]["signature"] for file in folder.glob("*.json")}
    seen, slow = Counter[str](), list[tuple[float, int]]()
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        judge = Judge(Path(scratch))
        for number in range(first, last):
            name, mutations = input_by_number(number)
            answer = judge.judge(name, input_files(name, mutations))
            slow.append((answer.seconds, number))
            if number % 100 == 99:
                print(f"{number}: {time.perf_counter() - began:.0f} s", flush=True)
            seen[f"exit code {answer.exit_code}"] += 1
            seen.update(set(answer.findings))
            seen.update(f"note: {note}" for note in set(answer.notes))
            for signature in answer.findings:
                if signature not in known:
                    known.add(signature)
                    fewest = shrink_mutations(judge, name, mutations, signature)
                    store_finding(folder, signature, name, input_files(name, fewest))
                    print(f"{number} {name}: {signature}, by {fewest}", flush=True)
                    print("    " + answer.detail[-700:].replace("\n", "\n    "), flush=True)
            for note in answer.notes:
                if note not in known and note not in ("timed out", "out of memory"):
                    known.add(note)
                    print(f"{number} {name}: note: {note} {mutations}", flush=True)
        judge.close()
    print(
        f"{last - first} inputs in {time.perf_counter() - began:.0f} s; slowest:",
        [(n, round(s, 1)) for s, n in sorted(slow)[-8:]],
    )
    for what, count in seen.most_common():
        print(f"{count:6d}  {what}")
    return seen


if __name__ == "__main__":
    hunt(
        int(sys.argv[1]),
        int(sys.argv[2]),
        Path(sys.argv[3]) if len(sys.argv) > 3 else FINDINGS_FOLDER,
    )
