"""The commands that show a run: replay and watch."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request

import pytest
from cli_runner import check_wrong_use, run_cli

QUICK = ["--set", "duration=0.5", "--no-plots"]


@pytest.fixture
def run_folder(tmp_path, capsys):
    folder = tmp_path / "run"
    run_cli(capsys, "simulate", "circle", *QUICK, "--output", folder)
    return folder


def test_replay_writes_a_page_beside_the_run(run_folder, capsys):
    code, out, _ = run_cli(capsys, "replay", run_folder)
    assert code == 0 and out == f"Written to {run_folder / 'replay.html'}\n"
    page = (run_folder / "replay.html").read_text()
    assert "<title>circle</title>" in page and len(page) < 5e6


def test_replay_writes_elsewhere(run_folder, tmp_path, capsys):
    path = tmp_path / "other" / "page.html"
    code, _, _ = run_cli(capsys, "replay", run_folder, "--output", path)
    assert code == 0 and path.is_file()
    assert not (run_folder / "replay.html").exists()


def test_simulate_makes_the_same_page(run_folder, tmp_path, capsys):
    run_cli(capsys, "replay", run_folder)
    both = tmp_path / "both"
    code, _, _ = run_cli(capsys, "simulate", "circle", *QUICK, "--replay", "--output", both)
    assert code == 0
    sizes = [(folder / "replay.html").stat().st_size for folder in (run_folder, both)]
    assert sizes[0] == sizes[1]


def test_a_page_of_another_run_does_not_stay(run_folder, capsys):
    run_cli(capsys, "replay", run_folder)
    run_cli(capsys, "simulate", "rectangle", *QUICK, "--output", run_folder)
    assert not (run_folder / "replay.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["replay"], ["FOLDER"]),
        (["replay", "nowhere"], ["nowhere", "does not exist"]),
        (["replay", "."], ["log.npz", "simulate writes it"]),
        (["watch"], ["NAME"]),
        (["watch", "rectangel"], ["rectangel", "did you mean 'rectangle'"]),
        (["watch", "rectangle", "--port", "80"], ["--port", "1024"]),
        (["watch", "rectangle", "--set", "period=fast"], ["period"]),
        (["watch", "rectangle", "--seed", "-1"], ["--seed"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert list(tmp_path.iterdir()) == []


def test_replay_names_a_place_that_cannot_be_written(run_folder, capsys):
    arguments = ["replay", run_folder, "--output", "/dev/null/x.html"]
    check_wrong_use(capsys, arguments, ["/dev/null/x.html", "cannot be"])


def test_watch_names_a_port_that_is_taken(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        check_wrong_use(capsys, ["watch", "rectangle", "--port", port], [str(port), "choose"])


def test_watch_serves_a_page_and_ends_with_ctrl_c(tmp_path):
    command = [sys.executable, "-u", "-m", "mirte_drake", "watch", "circle", "--dark"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        address = line.split()[1]
        assert line.startswith("Open http://127.0.0.1:") and "Ctrl-C" in line
        with urllib.request.urlopen(address) as page:
            assert b"MeshCat" in page.read()
        time.sleep(1.0)  # It waits for somebody to open the page.
        os.kill(process.pid, signal.SIGINT)
        rest, _ = process.communicate(timeout=20)
        assert process.returncode == 0 and rest == "Stopped.\n"
    finally:
        process.kill()
    assert list(tmp_path.iterdir()) == []
