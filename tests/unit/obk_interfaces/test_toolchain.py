"""Libraries, units and command lines: compilers, and relocatable results."""

import sysconfig
from pathlib import Path

import pytest

from obk_interfaces import BuildToolError, Interface, InterfacePackage
from obk_interfaces.package import PackageTree
from obk_interfaces.prefix import Prefixes, site_packages_in
from obk_interfaces.toolchain import (
    Toolchain,
    compile_command,
    find_compilers,
    find_python_headers,
    libraries_of,
    link_command,
    object_of,
    write_units,
)

TOOLS = Toolchain(cc=("cc",), cxx=("c++",), includes=())


@pytest.fixture
def tree(tmp_path: Path) -> PackageTree:
    package = InterfacePackage(
        root=tmp_path / "source",
        name="my_msgs",
        version="1.0.0",
        depends=("std_msgs",),
        interfaces=(Interface(kind="msg", name="A"), Interface(kind="msg", name="B")),
    )
    tree = PackageTree(package=package, root=tmp_path / "build")
    tree.clear()
    return tree


def test_libraries_come_after_those_they_are_linked_with(tree: PackageTree) -> None:
    done = {"rosidl_runtime_c", "rcutils"}
    for library in libraries_of(tree, ["std_msgs"]):
        own = {link for link in library.links if link.startswith("my_msgs__")}
        assert own <= done
        done.add(Path(library.file).stem.removeprefix("lib"))


def test_run_paths_are_relative_to_the_library(tree: PackageTree, tmp_path: Path) -> None:
    prefixes = Prefixes(layers=(), ros=tmp_path / "ros")
    *shared, module = (
        link_command(library, [], tree=tree, prefixes=prefixes, toolchain=TOOLS)
        for library in libraries_of(tree, [])
    )
    assert all("-Wl,-rpath,$ORIGIN" in command for command in shared)
    assert "-Wl,-rpath,$ORIGIN/../../.." in module
    lib = site_packages_in(tree.install) / "my_msgs" / ".." / ".." / ".." / ".."
    assert (lib / "lib").resolve() == tree.install / "lib"


def test_the_module_loads_the_type_supports_that_are_opened_by_name(tree: PackageTree) -> None:
    module = libraries_of(tree, [])[-1]
    assert module.forced_links == (
        "my_msgs__rosidl_typesupport_fastrtps_c",
        "my_msgs__rosidl_typesupport_introspection_c",
    )


def test_compiled_code_has_no_path_of_the_build_machine(tree: PackageTree) -> None:
    command = compile_command(Path("a.c"), Path("a.o"), tree=tree, includes=[], toolchain=TOOLS)
    assert f"-ffile-prefix-map={tree.root}=." in command


@pytest.mark.parametrize(("unit", "start"), [("a.c", "cc"), ("a.cpp", "c++")])
def test_each_language_has_its_compiler(tree: PackageTree, unit: str, start: str) -> None:
    command = compile_command(Path(unit), Path("a.o"), tree=tree, includes=[], toolchain=TOOLS)
    assert command[0] == start


def test_clashing_sources_stay_alone_and_the_others_are_one_unit(tree: PackageTree) -> None:
    library = libraries_of(tree, [])[0]
    units = write_units(library, tree.objects)
    assert [unit.name for unit in units] == [
        "a__description.c",
        "b__description.c",
        "libmy_msgs__rosidl_generator_c.unity.c",
    ]
    assert len({object_of(library, unit, tree.objects) for unit in units}) == 3


def test_a_missing_compiler_names_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(BuildToolError) as caught:
        find_compilers()
    assert str(caught.value) == (
        "no C compiler found (gcc, cc, clang): install one "
        "(Debian, Ubuntu: apt install g++; Fedora: dnf install gcc-c++)"
    )


def test_a_missing_compiler_of_the_environment_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", "/nowhere/cc -m64")
    with pytest.raises(BuildToolError, match=r"CC=/nowhere/cc -m64"):
        find_compilers()


def test_a_compiler_of_the_environment_keeps_its_options(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    compiler = tmp_path / "cc"
    compiler.touch(mode=0o755)
    monkeypatch.setenv("CC", f"{compiler} -m64")
    monkeypatch.setenv("CXX", str(compiler))
    assert find_compilers() == ((str(compiler), "-m64"), (str(compiler),))


def test_missing_python_headers_name_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    paths = {"include": str(tmp_path), "platinclude": str(tmp_path)}
    monkeypatch.setattr(sysconfig, "get_paths", lambda: paths)
    monkeypatch.setattr(sysconfig, "get_config_var", lambda _: None)
    with pytest.raises(BuildToolError, match=r"Python\.h.*python3\.\d"):
        find_python_headers()
