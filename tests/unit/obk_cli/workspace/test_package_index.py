import os
import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli.config.environment import Command, ExecutableMissing
from obk_cli.workspace import package_index
from obk_cli.workspace.entry_points import source_console_scripts
from obk_cli.workspace.package_index import PackageIndex, find_workspace, package_folders

PACKAGE_XML = "<package><name>{}</name></package>"
SETUP_PY = "setup(entry_points={'console_scripts': ['run = demo.run:main', 'x=demo.x:go']})"


def make_package(folder: Path, name: str, **files: str) -> Path:
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(PACKAGE_XML.format(name))
    for file, text in files.items():
        (folder / file.replace("_", ".")).write_text(text)
    return folder


def make_program(path: Path) -> Path:
    path.parent.mkdir(parents=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


def index(*workspaces: Path, prefixes: tuple[Path, ...] = ()) -> PackageIndex:
    return PackageIndex(workspaces=workspaces, prefixes=prefixes)


def test_the_workspace_is_the_nearest_folder_with_src_or_git(tmp_path: Path) -> None:
    inner = tmp_path / "ws" / "src" / "demo" / "config"
    inner.mkdir(parents=True)
    assert find_workspace(inner) == tmp_path / "ws"
    (tmp_path / "ws" / "src" / "demo" / ".git").touch()
    assert find_workspace(inner) == tmp_path / "ws" / "src" / "demo"


def test_a_package_with_a_cpp_folder_is_no_workspace(tmp_path: Path) -> None:
    package = make_package(tmp_path / "ws" / "src" / "demo", "demo")
    (package / "src").mkdir()
    assert find_workspace(package / "src") == tmp_path / "ws"


def test_packages_next_to_the_configs_folder_form_a_workspace(tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    assert find_workspace(tmp_path / "config") == tmp_path / "config"
    make_package(tmp_path / "arm", "arm")
    assert find_workspace(tmp_path / "config") == tmp_path


def test_a_folder_of_root_above_the_user_s_ends_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "root/mine/config").mkdir(parents=True)
    (tmp_path / "root/src").mkdir()

    def owner_and_mode(folder: Path) -> tuple[int, int]:
        return (0 if folder.name == "root" else 1000), 0o755

    monkeypatch.setattr(package_index, "_owner_and_mode", owner_and_mode)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    start = tmp_path / "root/mine/config"
    assert find_workspace(start) == start


@pytest.mark.parametrize("mode", [0o1700, 0o757, 0o1777])
def test_a_folder_that_others_can_fill_ends_the_search(tmp_path: Path, mode: int) -> None:
    (tmp_path / "shared/mine/config").mkdir(parents=True)
    make_package(tmp_path / "shared/arm", "arm")
    (tmp_path / "shared/.git").touch()
    assert find_workspace(tmp_path / "shared/mine/config") == tmp_path / "shared"
    (tmp_path / "shared").chmod(mode)
    for start in ("shared/mine/config", "shared/mine"):
        assert find_workspace(tmp_path / start) == tmp_path / start
    assert find_workspace(tmp_path / "shared") == tmp_path / "shared"


def test_the_search_ends_at_the_home_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "home/config").mkdir(parents=True)
    (tmp_path / ".git").touch()
    assert find_workspace(tmp_path / "home/config") == tmp_path
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert find_workspace(tmp_path / "home/config") == tmp_path / "home/config"
    (tmp_path / "home/src").mkdir()
    assert find_workspace(tmp_path / "home/config") == tmp_path / "home"


def test_a_folder_of_another_user_ends_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "theirs/mine").mkdir(parents=True)
    (tmp_path / "theirs/.git").touch()
    assert find_workspace(tmp_path / "theirs/mine") == tmp_path / "theirs"
    stat = Path.stat

    def stat_of(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        found = stat(path, follow_symlinks=follow_symlinks)
        if path.name != "theirs":
            return found
        return os.stat_result((*found[:4], 54321, *found[5:]))

    monkeypatch.setattr(Path, "stat", stat_of)
    assert find_workspace(tmp_path / "theirs/mine") == tmp_path / "theirs/mine"


def test_a_test_does_not_see_the_packages_of_others(tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    others = make_package(tmp_path.parent / f"{tmp_path.name}_other", "other")
    assert find_workspace(tmp_path / "config") == tmp_path / "config"
    assert find_workspace(tmp_path) == tmp_path
    assert others.is_dir()


def test_built_ignored_and_hidden_folders_hold_no_packages(tmp_path: Path) -> None:
    make_package(tmp_path / "src" / "kept", "kept_by_name")
    make_package(tmp_path / "src" / "kept" / "inner", "inner")
    for folder in ("build", "install", "log", ".hidden", "ignored"):
        make_package(tmp_path / folder / "p", folder.strip("."))
    (tmp_path / "ignored" / "COLCON_IGNORE").touch()
    make_package(tmp_path / "venv" / "p", "in_venv")
    (tmp_path / "venv" / "pyvenv.cfg").touch()
    assert dict(index(tmp_path).source_packages) == {"kept_by_name": tmp_path / "src" / "kept"}


def test_a_script_in_source_runs_with_this_python_and_the_packages_path(tmp_path: Path) -> None:
    root = make_package(tmp_path / "demo", "demo", setup_py=SETUP_PY)
    command = index(tmp_path).find_executable("demo", "run")
    assert isinstance(command, Command)
    code = "import sys; from demo.run import main; sys.exit(main())"
    assert command.arguments == (sys.executable, "-P", "-c", code)
    assert command.python_path == (root,)


def test_source_wins_over_an_install_prefix(tmp_path: Path) -> None:
    program = make_program(tmp_path / "prefix" / "lib" / "demo" / "run")
    installed = index(tmp_path / "ws", prefixes=(tmp_path / "prefix",))
    command = installed.find_executable("demo", "run")
    assert isinstance(command, Command)
    assert command.arguments == (str(program),)
    make_package(tmp_path / "ws" / "demo", "demo", setup_py=SETUP_PY)
    both = index(tmp_path / "ws", prefixes=(tmp_path / "prefix",))
    command = both.find_executable("demo", "run")
    assert isinstance(command, Command)
    assert command.arguments[0] == sys.executable


def test_a_miss_reports_the_searched_folders_and_existing_packages(tmp_path: Path) -> None:
    make_package(tmp_path / "demo", "demo", setup_py=SETUP_PY)
    make_program(tmp_path / "prefix" / "lib" / "demo" / "built")
    packages = index(tmp_path, prefixes=(tmp_path / "prefix",))
    assert packages.find_executable("demo", "rum") == ExecutableMissing(
        package="demo",
        executable="rum",
        package_found=True,
        searched=(f"{tmp_path} (sources)", str(tmp_path / "prefix")),
        available=("built", "run", "x"),
    )
    other = packages.find_executable("other", "run")
    assert isinstance(other, ExecutableMissing)
    assert not other.package_found
    assert other.looked == f"searched {tmp_path} (sources), {tmp_path / 'prefix'}"


@pytest.mark.parametrize("place", ["build/demo", "install/demo/share/demo", "a/b/log/demo"])
def test_a_package_outside_the_search_path_is_reported(tmp_path: Path, place: str) -> None:
    folder = make_package(tmp_path / place, "demo")
    missing = index(tmp_path).find_executable("demo", "run")
    assert isinstance(missing, ExecutableMissing)
    assert not missing.package_found
    assert missing.looked.startswith(
        f"it exists in {folder}, but folders named `build`, `install`, `log` are not searched"
    )
    assert missing.looked.endswith(f"searched {tmp_path} (sources)")


def test_a_console_script_of_an_installed_distribution_is_found(tmp_path: Path) -> None:
    command = index(tmp_path).find_executable("pytest", "pytest")
    assert isinstance(command, Command)
    assert command.function is not None


def test_the_configs_own_workspace_wins_over_the_current_one(tmp_path: Path) -> None:
    own = make_package(tmp_path / "own" / "arm", "arm")
    make_package(tmp_path / "current" / "arm", "arm")
    packages = index(tmp_path / "own", tmp_path / "current")
    assert packages.find_package_share("arm") == own


def test_shares_are_found_in_source_and_in_prefixes(tmp_path: Path) -> None:
    source = make_package(tmp_path / "ws" / "arm", "arm_model")
    share = tmp_path / "prefix" / "share" / "leg_model"
    share.mkdir(parents=True)
    packages = index(tmp_path / "ws", prefixes=(tmp_path / "prefix",))
    assert packages.find_package_share("arm_model") == source
    assert packages.find_package_share("leg_model") == share
    assert packages.find_package_share("none") is None


def test_prefixes_are_those_of_ament_then_this_pythons(tmp_path: Path) -> None:
    environment = {"AMENT_PREFIX_PATH": os.pathsep.join(["/a", "/b", "/a"])}
    packages = PackageIndex.around(tmp_path, tmp_path, environment)
    assert packages.prefixes == (Path("/a"), Path("/b"), Path(sys.prefix))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("setup.py", SETUP_PY),
        (
            "setup.py",
            "name: str = 'demo'\nsetup(entry_points={'console_scripts': "
            "[f'run = {name}.run:main', 'x = ' + name + '.x:go']})\n",
        ),
        (
            "setup.py",
            "RUN = ['run = demo.run:main']\n"
            "setup(entry_points=dict(console_scripts=[*RUN] + ['x = demo.x:go']))\n",
        ),
        (
            "setup.py",
            "more = ['x = demo.x:go'] if X else []\n"
            "setup(entry_points={'console_scripts': sorted(['run = demo.run:main']) + more})\n",
        ),
        (
            "setup.py",
            'setup(entry_points="[console_scripts]\\nrun = demo.run:main\\nx = demo.x:go")\n',
        ),
        (
            "setup.py",
            "P = 'demo'\nsetup(entry_points={'console_scripts': [\n"
            "    *[f'{n} = demo.{n}:main' for n in ('run',)],\n"
            "    '{} = {}.x:go'.format('x', P),\n]})\n",
        ),
        (
            "setup.py",
            "P = 'demo'\nsetup(entry_points={'console_scripts': [\n"
            "    'run = %s.run:main' % P, '%s = %s.x:go' % ('x', P),\n]})\n",
        ),
        (
            "setup.cfg",
            "[options.entry_points]\nconsole_scripts =\n  run = demo.run:main\n  x = demo.x:go\n",
        ),
        ("pyproject.toml", "[project.scripts]\nrun = 'demo.run:main'\nx = 'demo.x:go'\n"),
    ],
)
def test_scripts_are_read_from_each_kind_of_file(tmp_path: Path, file: str, text: str) -> None:
    (tmp_path / file).write_text(text)
    scripts = source_console_scripts(tmp_path)
    assert {name: (s.module, s.function) for name, s in scripts.items()} == {
        "run": ("demo.run", "main"),
        "x": ("demo.x", "go"),
    }


@pytest.mark.parametrize(
    "scripts",
    [
        "[f'{n} = demo.{n}:main' for n in NAMES]",
        "['run = demo.run:main', '%s = demo.x:go' % x]",
        "['{0} = demo.x:go'.format('x')]",
        "[entry(n) for n in ('run', 'x')]",
        "SCRIPTS",
        "[f'x = {NAME}.x:go']",
    ],
)
def test_a_missing_script_may_be_one_that_setup_py_computes(tmp_path: Path, scripts: str) -> None:
    setup = f"NAME = 'a'\nNAME = 'b'\nsetup(entry_points={{'console_scripts': {scripts}}})\n"
    make_package(tmp_path / "demo", "demo", setup_py=setup)
    answer = index(tmp_path).find_executable("demo", "x")
    assert isinstance(answer, ExecutableMissing)
    assert answer.computed_in == tmp_path / "demo/setup.py"


@pytest.mark.parametrize(
    "lines",
    [
        "add_executable(drive src/drive.cpp)",
        "ament_auto_add_executable(drive DIRECTORY src)",
        'rclcpp_components_register_node(drive_component PLUGIN "a::B" EXECUTABLE drive)',
        "set(N drive)\nadd_executable(${N} a.cpp)\nset(N b)\nadd_executable(${N} b.cpp)",
    ],
)
def test_an_executable_that_cmake_declares_is_not_built(tmp_path: Path, lines: str) -> None:
    root = make_package(tmp_path / "demo", "demo", CMakeLists_txt=f"project(demo)\n{lines}\n")
    answer = index(tmp_path).find_executable("demo", "drive")
    assert isinstance(answer, ExecutableMissing)
    assert answer.declared_in == root / "CMakeLists.txt"
    assert "drive" in answer.available
    other = index(tmp_path).find_executable("demo", "other")
    assert isinstance(other, ExecutableMissing)
    assert (other.declared_in, other.computed_in) == (None, None)


@pytest.mark.parametrize(
    "lines",
    [
        "foreach(name drive stop)\n  add_executable(${name} src/main.cpp)\nendforeach()",
        "macro(add_node name)\n  add_executable(${name}_node src/main.cpp)\nendmacro()",
        "set(name a)\nfunction(add_node name)\n  add_executable(${name} a.cpp)\nendfunction()",
        'rclcpp_components_register_node(c PLUGIN "a::B" EXECUTABLE ${name})',
    ],
)
def test_a_missing_executable_may_be_one_that_cmake_computes(tmp_path: Path, lines: str) -> None:
    root = make_package(tmp_path / "demo", "demo", CMakeLists_txt=f"project(demo)\n{lines}\n")
    answer = index(tmp_path).find_executable("demo", "drive")
    assert isinstance(answer, ExecutableMissing)
    assert (answer.declared_in, answer.computed_in) == (None, root / "CMakeLists.txt")
    make_program(tmp_path / "prefix/lib/demo/stop")
    built = index(tmp_path, prefixes=(tmp_path / "prefix",)).find_executable("demo", "drive")
    assert isinstance(built, ExecutableMissing)
    assert built.computed_in is None


def make_script(path: Path, first: str = "#!/usr/bin/env python3\n") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(first)
    return path


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("drive.py", "install(PROGRAMS nodes/drive.py DESTINATION lib/${PROJECT_NAME})"),
        ("drive", 'INSTALL( PROGRAMS "nodes/drive.py"\n RENAME drive DESTINATION lib/demo )'),
        ("drive.py", "set(NODES nodes/drive.py other.py)\ninstall(PROGRAMS ${NODES}\n"
         "  DESTINATION lib/${PROJECT_NAME}  # here\n)"),
        ("drive.py", "install(PROGRAMS ${CMAKE_CURRENT_SOURCE_DIR}/nodes/drive.py\n"
         "  PERMISSIONS OWNER_EXECUTE DESTINATION lib/${PROJECT_NAME})"),
    ],
)  # fmt: skip
def test_a_script_that_cmake_installs_runs_from_its_source(
    tmp_path: Path, name: str, lines: str
) -> None:
    root = make_package(tmp_path / "demo", "demo")
    script = make_script(root / "nodes" / "drive.py")
    (root / "CMakeLists.txt").write_text(f"project(demo)\n{lines}\n")
    command = index(tmp_path).find_executable("demo", name)
    assert isinstance(command, Command)
    assert command.arguments == (sys.executable, str(script)), "a build sets the execute bit"
    script.chmod(0o755)
    command = index(tmp_path).find_executable("demo", name)
    assert isinstance(command, Command)
    assert command.arguments == (str(script),)


@pytest.mark.parametrize(
    "lines",
    [
        "# install(PROGRAMS nodes/drive.py DESTINATION lib/demo)",
        "install(PROGRAMS nodes/drive.py DESTINATION share/demo)",
        "install(PROGRAMS nodes/drive.py DESTINATION lib/${OTHER})",
        "install(FILES nodes/drive.py DESTINATION lib/demo)",
        "install(PROGRAMS missing/drive.py DESTINATION lib/demo)",
        "install(PROGRAMS",
    ],
)
def test_what_cmake_does_not_install_as_a_program_is_missing(tmp_path: Path, lines: str) -> None:
    root = make_package(tmp_path / "demo", "demo")
    make_script(root / "nodes" / "drive.py")
    (root / "CMakeLists.txt").write_text(f"project(demo)\n{lines}\n")
    assert isinstance(index(tmp_path).find_executable("demo", "drive.py"), ExecutableMissing)


def test_variables_that_double_again_and_again_take_no_time(tmp_path: Path) -> None:
    doubled = "".join(f"set(V{n + 1} ${{V{n}}}${{V{n}}})\n" for n in range(100))
    root = make_package(tmp_path / "demo", "demo")
    (root / "CMakeLists.txt").write_text(f"set(V0 a)\n{doubled}install(PROGRAMS ${{V100}})\n")
    assert isinstance(index(tmp_path).find_executable("demo", "a"), ExecutableMissing)
    items = ", ".join(f"'{number}'" for number in range(30))
    nested = f"[[[[f'{{a}}{{b}}' for a in ({items})] for b in ({items})] for c in ({items})]]"
    (root / "setup.py").write_text(f"setup(entry_points={{'console_scripts': {nested}}})\n")
    assert isinstance(index(tmp_path).find_executable("demo", "a"), ExecutableMissing)


def test_a_script_that_setup_py_installs_runs_from_its_source(tmp_path: Path) -> None:
    root = make_package(tmp_path / "demo", "demo", setup_py="setup(scripts=['demo/drive.py'])")
    script = make_script(root / "demo" / "drive.py")
    command = index(tmp_path).find_executable("demo", "drive.py")
    assert isinstance(command, Command)
    assert command.arguments == (sys.executable, str(script))


def test_a_node_imports_from_all_packages_of_its_workspace(tmp_path: Path) -> None:
    root = make_package(tmp_path / "demo", "demo", setup_py=SETUP_PY)
    script = make_program(root / "scripts" / "drive")
    tools = make_package(tmp_path / "tools", "tools", setup_py="")
    make_script(tools / "src" / "tools" / "__init__.py", "")
    math = make_package(tmp_path / "math", "lab-math")
    make_script(math / "python" / "lab_math" / "__init__.py", "")
    (math / "CMakeLists.txt").write_text(
        "project(lab-math)\nament_python_install_package(lab_math PACKAGE_DIR python/lab_math)\n"
    )
    checkout = make_package(tmp_path / "obelisk", "obelisk_py", setup_py="")
    make_script(checkout / "obelisk_py" / "__init__.py", "")
    make_package(tmp_path / "only_data", "only_data", setup_py="")
    others = {tools / "src", math / "python"}
    for name in ("run", script.name):
        command = index(tmp_path).find_executable("demo", name)
        assert isinstance(command, Command)
        assert {*command.python_path} - {root} == others
    assert isinstance(command := index(tmp_path).find_executable("demo", "run"), Command)
    assert command.python_path[0] == root


def test_packages_of_another_workspace_are_not_imported(tmp_path: Path) -> None:
    root = make_package(tmp_path / "own" / "demo", "demo", setup_py=SETUP_PY)
    other = make_package(tmp_path / "other" / "tools", "tools", setup_py="")
    make_script(other / "tools" / "__init__.py", "")
    command = index(tmp_path / "own", tmp_path / "other").find_executable("demo", "run")
    assert isinstance(command, Command)
    assert command.python_path == (root,)


@pytest.mark.parametrize("file", ["setup.py", "setup.cfg", "pyproject.toml"])
def test_a_broken_file_has_no_scripts(tmp_path: Path, file: str) -> None:
    for data in (b"[[[ \xff (", b"a" + b".a" * 20_000):
        (tmp_path / file).write_bytes(data)
        assert source_console_scripts(tmp_path) == {}


def test_a_package_in_a_src_folder_is_imported_from_there(tmp_path: Path) -> None:
    (tmp_path / "src" / "demo").mkdir(parents=True)
    (tmp_path / "setup.py").write_text(SETUP_PY)
    assert source_console_scripts(tmp_path)["run"].package_root == "src"


def test_a_folder_that_may_not_be_entered_is_passed_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_package(tmp_path / "src/demo", "demo")
    make_package(tmp_path / "src/locked/other", "other")
    # The user who runs the tests may be root.
    monkeypatch.setattr(os, "access", lambda path, _: Path(path).name != "locked")
    assert list(index(tmp_path).source_packages) == ["demo"]


def test_a_package_xml_that_may_not_be_read_counts_under_its_folders_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_package(tmp_path / "src/demo", "demo")
    locked = make_package(tmp_path / "src/locked", "other") / "package.xml"
    read_text = Path.read_text

    def read(path: Path, encoding: str | None = None, errors: str | None = None) -> str:
        if path == locked:
            raise PermissionError(13, "Permission denied", str(path))
        return read_text(path, encoding, errors)

    # The user who runs the tests may be root.
    monkeypatch.setattr(Path, "read_text", read)
    assert sorted(index(tmp_path).source_packages) == ["demo", "locked"]


def test_a_library_in_the_working_folder_is_ignored(tmp_path: Path) -> None:
    root = make_package(tmp_path / "demo", "demo", setup_py=SETUP_PY)
    (root / "demo").mkdir()
    (root / "demo" / "run.py").write_text(
        "import json\n\n\ndef main():\n    print(json.dumps(1))\n"
    )
    here = tmp_path / "here"
    here.mkdir()
    (here / "json.py").write_text("raise SystemExit('this file was run')")
    command = index(tmp_path).find_executable("demo", "run")
    assert isinstance(command, Command)
    done = subprocess.run(
        command.arguments,
        cwd=here,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("1\n", "")


def test_files_of_a_package_that_never_end_are_not_read(tmp_path: Path) -> None:
    package = make_package(tmp_path / "demo", "demo")
    (package / "setup.py").symlink_to("/dev/zero")
    (package / "msg").mkdir()
    os.mkfifo(package / "msg" / "Odd.msg")
    packages = index(tmp_path)
    assert isinstance(packages.find_executable("demo", "run"), ExecutableMissing)
    assert packages.message_definition("demo", "Odd") is None


def test_links_that_lead_back_are_not_searched_again(tmp_path: Path) -> None:
    package = make_package(tmp_path / "ws" / "src" / "demo", "demo")
    for name, target in (("up", ".."), ("here", "."), ("all", "/")):
        (package.parent / name).symlink_to(target)
    elsewhere = make_package(tmp_path / "elsewhere" / "other", "other").parent
    (package.parent / "linked").symlink_to(elsewhere)
    found = list(package_folders(tmp_path / "ws"))
    assert found == [package, package.parent / "linked/other"]
    assert index(tmp_path / "ws").left_out_packages == {}
