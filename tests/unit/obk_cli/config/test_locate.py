"""The search paths of files in a config, and suggestions for missing files."""

from pathlib import Path

import pytest

from obk_cli.compiler import Options, Outcome, compile_config


def compiled(folder: Path, model: str, package: str = "demo") -> Outcome:
    (folder / "c.yaml").write_text(
        f"robot: {{pkg: {package}, executable: e, is_simulated: true, "
        f"sim: {{model_xml_path: {model}}}}}\n"
    )
    return compile_config(
        str(folder / "c.yaml"), Options(variables={}, working_folder=folder, ignore=("OBK2",))
    )


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("amr.xml", "did you mean `arm.xml`?"),
        ("models/amr.xml", "did you mean `models/arm.xml`?"),
        ("model/arm.xml", "did you mean `arm.xml` or `models/arm.xml`?"),
        ("leg.xml", "tried "),
        ("~/arm.xml", "`~` is not expanded, write `${HOME}/arm.xml`; tried "),
        ("arm.yaml", "tried "),
    ],
)
def test_a_missing_model_is_reported_with_the_existing_ones(
    tmp_path: Path, written: str, meant: str
) -> None:
    (tmp_path / "models").mkdir()
    for name in ("arm.xml", "models/arm.xml", "models/hand.xml"):
        (tmp_path / name).write_text("<mujoco/>")
    (fault,) = (f for f in compiled(tmp_path, written).diagnostics if f.code == "OBK301")
    assert (fault.help or "").startswith(meant)


@pytest.mark.parametrize("written", [".", "/", "..", "loop", "loop/x.xml"])
def test_paths_that_lead_to_no_file_are_not_found(tmp_path: Path, written: str) -> None:
    (tmp_path / "loop").symlink_to("loop")
    (fault,) = (f for f in compiled(tmp_path, written).diagnostics if f.code == "OBK301")
    assert "did you mean" not in (fault.help or "")


def test_existing_paths_that_are_no_files_are_not_suggested(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").mkdir()
    (fault,) = (f for f in compiled(tmp_path, "arm.xml").diagnostics if f.code == "OBK301")
    assert "did you mean" not in (fault.help or "")


def test_names_that_no_file_can_have_are_not_found(tmp_path: Path) -> None:
    outcome = compiled(tmp_path, "a" * 300 + ".xml", package="b" * 300)
    assert {"OBK301", "OBK401"} <= {fault.code for fault in outcome.diagnostics}


def test_nothing_is_suggested_if_a_link_leads_out_of_the_folder(tmp_path: Path) -> None:
    # A package contains no other packages, so the search does not continue behind the link.
    (tmp_path / "package.xml").write_text("<package><name>demo</name></package>")
    (tmp_path / "link").symlink_to("/")
    (fault,) = (f for f in compiled(tmp_path, "link/x.xml").diagnostics if f.code == "OBK301")
    assert "did you mean" not in (fault.help or "")
