"""Specs, templates and packages in memory for the scaffolding tests."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

from obk_cli.files import resource_folder
from obk_cli.scaffold.compose import compose_package, layers_of
from obk_cli.scaffold.kinds import Kind
from obk_cli.scaffold.package_spec import PackageRequest, PackageSpec, check_request
from obk_cli.scaffold.templates import RenderedFile, Template, TemplateLibrary

from .owners import no_owner


@pytest.fixture
def make_spec() -> Callable[..., PackageSpec]:
    """Create a checked spec from user input."""

    def make(kind: Kind = "controller", name: str = "foo", **typed: Any) -> PackageSpec:
        spec = check_request(PackageRequest(kind=kind, name=name, **typed), owner_of=no_owner)
        assert isinstance(spec, PackageSpec), spec
        return spec

    return make


@pytest.fixture
def templates() -> Callable[[PackageSpec], tuple[Template, ...]]:
    """The project's own templates for a package outside any workspace."""
    library = TemplateLibrary(own=resource_folder("templates"))
    return lambda spec: library.read(layers_of(spec, has_settings=False))


@pytest.fixture
def package(
    make_spec: Callable[..., PackageSpec], templates: Callable[[PackageSpec], tuple[Template, ...]]
) -> Callable[..., dict[PurePosixPath, RenderedFile]]:
    """The files of a package, by path."""

    def make(
        kind: Kind = "controller", name: str = "foo", **typed: Any
    ) -> dict[PurePosixPath, RenderedFile]:
        spec = make_spec(kind, name, **typed)
        made = compose_package(spec, templates(spec))
        assert made.edits == ()
        return {file.path: file for file in made.files}

    return make


@pytest.fixture(scope="session")
def mypy_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library types that mypy knows."""
    return tmp_path_factory.mktemp("mypy")


@pytest.fixture
def tree() -> Callable[[Path], dict[str, bytes]]:
    """All files below a folder with their content, including hidden ones."""
    return lambda root: {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }
