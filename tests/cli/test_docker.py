"""`docker/run` against a fake engine that records its arguments, and the meshes of an installed
package."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from fenicsrom.scene.reading.reading import shared_meshes

CHECKOUT = Path(__file__).resolve().parents[2]
ENGINE = """#!/bin/sh
case "$1" in
    info) exit 0 ;;
    inspect) [ -e "$ENGINE_HOME/built" ] && grep -qx "$4" "$ENGINE_HOME/built" ;;
    build)
        printf '%s\\n' "$@" > "$ENGINE_HOME/build"
        sed -n '/^-t$/{n;p;}' "$ENGINE_HOME/build" >> "$ENGINE_HOME/built" ;;
    run) printf '%s\\n' "$@" > "$ENGINE_HOME/run"; exit 7 ;;
esac
"""


@pytest.fixture
def engine(tmp_path: Path) -> Path:
    (tmp_path / "docker").write_text(ENGINE)
    (tmp_path / "docker").chmod(0o755)
    return tmp_path


def docker_run(
    engine: Path, *command: str, checkout: Path = CHECKOUT, folder: Path = CHECKOUT
) -> tuple[int, str]:
    """Run docker/run with a fake engine first in PATH; give its exit code and output."""
    path = f"{engine}:{os.environ['PATH']}"
    environment = {
        "PATH": path,
        "ENGINE_HOME": str(engine),
        "XDG_CACHE_HOME": str(engine / "cache"),
    }
    script = str(checkout / "docker" / "run")
    done = subprocess.run(
        [script, *command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    return done.returncode, done.stderr


def test_image_is_built_once_and_command_keeps_folder_and_exit_code(engine: Path) -> None:
    code, said = docker_run(engine, "python3", "-c", "print('a  b')", folder=CHECKOUT / "tests")
    assert code == 7
    assert "building" in said
    asked = (engine / "run").read_text().splitlines()
    assert asked[-3:] == ["python3", "-c", "print('a  b')"]
    assert asked[asked.index("-w") + 1] == "/src/tests"
    assert f"{CHECKOUT}:/src" in asked
    assert f"{os.getuid()}:{os.getgid()}" in asked
    assert any(word.startswith("PYTHONPYCACHEPREFIX=/cache/") for word in asked)
    assert docker_run(engine, "true") == (7, "")


def test_command_is_told_the_commit_and_which_outputs_would_vanish(engine: Path) -> None:
    def settings(*command: str) -> dict[str, str]:
        docker_run(engine, *command)
        asked = (engine / "run").read_text().splitlines()
        return dict(word.split("=", 1) for word in asked if word.startswith("FENICSROM_"))

    found = settings("mpirun", "-n", "2", "fenicsrom", "run", "scene.toml")
    assert str(CHECKOUT) in found["FENICSROM_CONTAINER"]
    assert "FENICSROM_CONTAINER" not in settings("python3", "-m", "pytest")
    git = ["git", "-C", str(CHECKOUT), "rev-parse", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    assert found["FENICSROM_COMMIT"].startswith(commit)


def test_image_of_the_program_is_built_up_to_a_stage_after_the_environment(engine: Path) -> None:
    assert docker_run(engine, "--image", "mine", "program")[0] == 0
    assert (engine / "built").read_text().splitlines()[1:] == ["mine"]
    asked = (engine / "build").read_text().splitlines()
    assert asked[asked.index("--target") + 1] == "program"
    assert asked[-1] == str(CHECKOUT)


def test_no_secret_is_mounted_on_a_file_of_the_image() -> None:
    # buildah deletes the file of the layer below such a mount, and the next `pip` fails
    text = (CHECKOUT / "docker" / "Dockerfile").read_text()
    targets = [word.split("target=")[1] for word in text.split() if "type=secret" in word]
    assert targets and all(target.startswith("/tmp/") for target in targets)


@pytest.mark.slow
def test_shared_meshes_are_found_in_checkout_and_installation(tmp_path: Path) -> None:
    assert (shared_meshes() / "beam2d.geo").is_file()
    site = tmp_path / "site"
    source = tmp_path / "source"
    source.mkdir()
    (source / "README.md").write_text("")
    for name in ("pyproject.toml", "LICENSE", "fenicsrom", "meshes", "demos"):
        (source / name).symlink_to(CHECKOUT / name)
    install = ["python3", "-m", "pip", "install", "--no-deps", "--no-build-isolation", "--quiet"]
    subprocess.run([*install, "--target", site, source], check=True)
    show = (
        "from fenicsrom.scene.reading.reading import shared_meshes\n"
        "print(*sorted(path.name for path in shared_meshes().glob('*.geo')))"
    )
    found = subprocess.run(
        ["python3", "-c", show],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.split() == sorted(path.name for path in (CHECKOUT / "meshes").glob("*.geo"))
