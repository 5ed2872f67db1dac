"""``wbc sweep``: many trials of a scenario, in processes or on a cluster, and what came of them."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TextIO, final

from wbc.campaign.cluster import connect, on_cluster
from wbc.campaign.figures import figures
from wbc.campaign.pool import in_processes
from wbc.campaign.report import page, table
from wbc.campaign.store import REPORT, TRIALS, Store
from wbc.campaign.trial import Done, Trial, trial_seed
from wbc.campaign.vary import Variation, drawn, read_variations
from wbc.cli.interrupt import Interrupts
from wbc.cli.progress import SlowNotice
from wbc.cli.session import file_name, load_with_settings
from wbc.cli.trial import crashed_line, first_tick, run_trial
from wbc.files import write_whole
from wbc.recording import installed_versions
from wbc.scenario import Loaded
from wbc.scenario.build import Assembly, build
from wbc.scenario.places import pairs_file

LOGS: Final = "trials"
"""Folder of the logs kept, one folder a trial."""
_OFTEN, _SELDOM = 0.5, 10.0  # between two lines on a terminal, and elsewhere [s]


def sweep_command(arguments: argparse.Namespace) -> int:
    """Do the trials that are not there yet, then tell of all; 0 when all are done."""
    interrupts: Interrupts = arguments.interrupts
    interrupts.check()
    loaded = load_with_settings(arguments)
    variations = read_variations(arguments.vary, loaded)
    folder = Path(arguments.out) if arguments.out else Path("sweeps") / file_name(loaded.path.stem)
    client = connect(arguments.scheduler) if arguments.scheduler else None
    if not variations and loaded.scenario.simulation.disturbances is None:
        _say("nothing but the seed differs from trial to trial (see --vary)")
    with SlowNotice(_say):
        assembly = build(loaded)
        first_tick(assembly)  # also: a scenario that cannot run is told before there are 1000
    interrupts.check()
    about = _about(assembly, arguments)
    store = Store(folder, about)
    campaign = _Campaign(loaded, variations, folder.resolve(), arguments, client)
    todo = [n for n in range(arguments.trials) if n not in store.lines]
    if len(todo) < arguments.trials:
        print(f"{arguments.trials - len(todo)} trials are there already")
    progress = _Progress(len(todo))
    interrupts.ticking = True
    try:
        results = contextlib.closing(campaign.results(todo, interrupts))
        with contextlib.suppress(KeyboardInterrupt), results as ended:
            for trial, done in ended:
                store.add(trial.number, crashed_line(trial) if done is None else done.line)
                progress.show(done)
    finally:
        interrupts.saving = True
        progress.clear()
        store.close()
    found = figures(store.lines[number] for number in sorted(store.lines))
    html = page(found, about).encode()
    write_whole(folder / REPORT, lambda file: file.write(html))
    for line in (*table(found), *progress.times(), f"written to {folder}: {TRIALS}, {REPORT}"):
        print(line)
    if interrupts.received:
        print("interrupted: the same command goes on from here", file=sys.stderr)
        return interrupts.exit_code
    return 0


def _about(assembly: Assembly, arguments: argparse.Namespace) -> dict[str, Any]:
    """What campaign.json says; the seed is apart from what else is set."""
    loaded = assembly.loaded
    set_otherwise = {k: v for k, v in loaded.overrides.items() if k != "simulation.seed"}
    return {
        "scenario": loaded.scenario.name,
        "scenario_sha256": loaded.hash,
        "robot_sha256": _robot_hash(assembly),
        "seed": loaded.scenario.simulation.seed,
        "overrides": set_otherwise,
        "varied": dict(sorted(text.split("=", 1) for text in arguments.vary)),
        "versions": installed_versions(),
    }


def _robot_hash(assembly: Assembly) -> str:
    """SHA-256 of the URDF as it was checked, and of the SRDF where that is read."""
    digest = hashlib.sha256(assembly.model.text.encode())
    srdf = assembly.loaded.scenario.robot.srdf
    if srdf is not None and assembly.pairs is not None:
        digest.update(pairs_file(srdf, assembly.loaded.path.parent).read_bytes())
    return digest.hexdigest()


@final
@dataclass
class _Campaign:
    """The trials of a campaign, and where they are done."""

    loaded: Loaded
    variations: tuple[Variation, ...]
    folder: Path
    arguments: argparse.Namespace
    client: Any

    def results(
        self, numbers: list[int], interrupts: Interrupts
    ) -> Generator[tuple[Trial, Done | None]]:
        """Trials as they end; None for one that took its process with it."""
        trials = [self._trial(number) for number in numbers]

        def stopped() -> bool:
            return bool(interrupts.received)

        if self.client is not None:
            return on_cluster(self.client, run_trial, trials, stopped)
        workers = self.arguments.workers or len(os.sched_getaffinity(0))
        return in_processes(run_trial, trials, workers, stopped)

    def _trial(self, number: int) -> Trial:
        loaded = self.loaded
        seed = trial_seed(loaded.scenario.simulation.seed, number)
        overrides, varied = drawn(self.variations, seed)
        return Trial(
            number=number,
            seed=seed,
            text=loaded.text.encode(),
            path=loaded.path.resolve(),
            shown=loaded.source.shown,
            overrides={**loaded.overrides, **overrides, "simulation.seed": seed},
            varied=varied,
            folder=self.folder / LOGS / f"{number:04d}",
            keep=self.arguments.keep,
        )


@final
class _Progress:
    """How many trials are done, on stderr."""

    def __init__(self, trials: int, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._trials, self._done, self._crashed = trials, 0, 0
        self._computing = 0.0
        self._began = self._said = time.monotonic()
        self._written = 0

    def show(self, done: Done | None) -> None:
        """One more trial is done, or has crashed."""
        self._done += 1
        if done is None:
            self._crashed += 1
        else:
            self._computing += done.seconds
        now = time.monotonic()
        if now - self._said < (_OFTEN if self._terminal else _SELDOM):
            return
        self._said = now
        left = (now - self._began) * (self._trials - self._done) / self._done
        crashed = f", {self._crashed} crashed" if self._crashed else ""
        text = f"{self._done} of {self._trials} trials done{crashed}, about {left:.0f} s left"
        if self._terminal:
            self._write("\r" + text.ljust(self._written))
            self._written = len(text)
        else:
            self._write(text + "\n")

    def clear(self) -> None:
        """Take the line away."""
        if self._written:
            self._write("\r" + " " * self._written + "\r")
            self._written = 0

    def times(self) -> list[str]:
        """How long it took."""
        ran = self._done - self._crashed
        if not ran:
            return []
        wall = time.monotonic() - self._began
        each = self._computing / ran
        return [f"took           {wall:.1f} s for {self._done} trials, {each:.2f} s computing each"]

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # nobody reads; the sweep goes on
            self._stream.write(text)
            self._stream.flush()


def _say(text: str) -> None:
    print(text, file=sys.stderr)
