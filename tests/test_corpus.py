"""Each config of the corpus gives exactly the expected findings.

The configs were not written for this project and are not changed. The expected findings are listed
here: line, column, code. Packages are searched next to the corpus only.
"""

from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.workspace.config_files import configs_that_include
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

CORPUS = Path(__file__).resolve().parents[2] / "shared" / "corpus"

# The C++ packages, `joy` and /obelisk_ws do not exist; the sensor periods of the dummy are half of
# its model's step; the estimators declare JointEncoders for a topic of ObkJointEncoders; an unused
# timer has a period of 100 s.
EXPECTED: dict[str, list[str]] = {
    "field/config/depth_config.yaml": [
        "1:1 OBK114",
    ],
    "field/config/dummy_composed.yaml": [
        "dummy_composed_base.yaml 5:10 OBK401",
        "dummy_composed_base.yaml 7:18 OBK404",
        "dummy_composed_base.yaml 15:9 OBK507",
        "dummy_composed_base.yaml 16:9 OBK507",
        "dummy_composed_base.yaml 32:10 OBK401",
        "dummy_composed_base.yaml 51:1 OBK401",
        "dummy_composed_robot_sim.yaml 4:10 OBK401",
        "dummy_composed_robot_sim.yaml 24:15 OBK215",
        "dummy_composed_robot_sim.yaml 29:18 OBK204",
        "dummy_composed_robot_sim.yaml 36:18 OBK204",
        "dummy_composed_robot_sim.yaml 42:18 OBK204",
    ],
    "field/config/dummy_composed_base.yaml": [
        "1:1 OBK016",
        "5:10 OBK401",
        "7:18 OBK404",
        "15:9 OBK507",
        "16:9 OBK507",
        "32:10 OBK401",
        "51:1 OBK401",
    ],
    "field/config/dummy_composed_robot_sim.yaml": [
        "1:1 OBK016",
        "4:10 OBK401",
        "15:9 OBK507",
        "16:9 OBK507",
        "24:15 OBK215",
    ],
    "field/config/dummy_cpp.yaml": [
        "3:10 OBK401",
        "5:18 OBK404",
        "13:9 OBK507",
        "14:9 OBK507",
        "31:10 OBK401",
        "53:10 OBK401",
        "74:15 OBK215",
        "79:18 OBK204",
        "86:18 OBK204",
        "92:18 OBK204",
        "100:18 OBK204",
        "105:1 OBK401",
    ],
    "field/config/dummy_cpp_scan.yaml": [
        "13:10 OBK401",
        "15:18 OBK404",
        "21:9 OBK507",
        "22:9 OBK507",
        "37:10 OBK401",
        "55:10 OBK401",
        "72:17 OBK215",
        "77:20 OBK204",
        "88:20 OBK204",
        "106:20 OBK204",
        "128:20 OBK204",
        "147:1 OBK401",
    ],
    "field/config/dummy_py.yaml": [
        "3:10 OBK401",
        "12:9 OBK507",
        "13:9 OBK507",
        "24:10 OBK401",
        "45:10 OBK401",
        "55:16 OBK204",
        "60:9 OBK506",
        "76:15 OBK215",
        "81:18 OBK204",
        "88:18 OBK204",
        "94:18 OBK204",
        "102:18 OBK204",
    ],
    "field/config/go2_cpp.yaml": [
        "4:10 OBK401",
        "12:9 OBK507",
        "13:9 OBK507",
        "51:27 OBK216",
        "71:19 OBK115",
        "123:16 OBK204",
        "146:9 OBK506",
        "208:12 OBK401",
        "211:13 OBK404",
        "218:11 OBK506",
        "228:1 OBK401",
    ],
    "seed/dummy.yaml": [
        "4:12 OBK401",
        "6:20 OBK404",
        "12:11 OBK507",
        "13:11 OBK507",
        "25:12 OBK401",
        "36:18 OBK203",
        "47:12 OBK401",
        "61:27 OBK301",
        "70:20 OBK204",
        "77:20 OBK204",
    ],
    "seed/dummy_py_sections.yaml": [
        "5:10 OBK401",
        "7:18 OBK404",
        "13:9 OBK507",
        "14:9 OBK507",
        "26:10 OBK401",
        "36:16 OBK203",
        "46:10 OBK401",
        "60:25 OBK301",
        "69:18 OBK204",
        "76:18 OBK204",
    ],
}


def findings(name: str) -> list[Diagnostic]:
    path = CORPUS / name
    environment = MachineEnvironment(path.parent, path.parent, {})
    environment.packages = PackageIndex(workspaces=(CORPUS / "field",), prefixes=())
    options = Options(
        variables={},
        working_folder=path.parent,
        environment=environment,
        including=configs_that_include,
    )
    return list(compile_config(str(path), options).diagnostics)


def reported(diagnostic: Diagnostic, name: str) -> str:
    """`12:3 OBK101`, with the file name if it is in an included file."""
    place = f"{diagnostic.span.line}:{diagnostic.span.column} {diagnostic.code}"
    file = Path(diagnostic.span.path).name
    return place if file == Path(name).name else f"{file} {place}"


@pytest.mark.mujoco
@pytest.mark.parametrize("name", EXPECTED)
def test_a_config_gives_the_expected_findings(name: str) -> None:
    assert [reported(finding, name) for finding in findings(name)] == EXPECTED[name]


def test_every_config_of_the_corpus_has_expected_findings() -> None:
    assert {str(p.relative_to(CORPUS)) for p in CORPUS.rglob("*.yaml")} == EXPECTED.keys()


@pytest.mark.mujoco
def test_the_seeds_example_is_reported_with_the_intended_topic() -> None:
    (dangling,) = [f for f in findings("seed/dummy.yaml") if f.code == "OBK203"]
    assert dangling.message == (
        "nothing publishes `/obelisk/dummy/sensor`, to which `/obelisk_estimation_0` subscribes"
    )
    assert dangling.severity == "error"
    assert (dangling.help or "").startswith(
        "did you mean `/obelisk/dummy/joint_encoders` (ObkJointEncoders, here it is JointEncoders)?"
    )
