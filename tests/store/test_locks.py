"""Temporary folders: kept while their writer lives, swept when it is gone."""

from __future__ import annotations

import os

import pytest

from tcrdata.store.locks import locked_folder, sweep


def test_what_is_locked_stays_and_what_is_not_goes(tmp_path):
    top = tmp_path / "tmp"
    living, lock = locked_folder(top)
    dead, released = locked_folder(top)
    os.close(released)
    sweep(top)
    assert living.is_dir()
    assert not dead.exists()
    os.close(lock)
    sweep(top)
    assert not top.exists()


def test_a_sweep_of_what_another_sweep_removed_is_silent(tmp_path):
    sweep(tmp_path / "absent")
    assert not (tmp_path / "absent").exists()


def test_a_stray_file_is_no_writers(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    sweep(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_file_in_the_folders_place_is_an_error_and_not_an_endless_loop(tmp_path):
    (tmp_path / "tmp").touch()
    with pytest.raises(OSError, match="no temporary folder can be made"):
        locked_folder(tmp_path / "tmp")
