"""The mesh about the plate: strongly graded, refined to both edges, half of the plane or all of it with a slit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.aero.linear_flow.extra import require_ngsolve
from hbnlp.core.checks import instance_of, real_number

if TYPE_CHECKING:
    import ngsolve


@dataclass(frozen=True, kw_only=True)
class MeshSettings:
    """Element sizes, in chords.

    Parameters
    ----------
    domain : float
        Distance of the inlet and of the top from the leading edge; the outlet is twice as far. The load at low
        frequency is in error by about a third of its inverse.
    plate : float
        Element size on the plate.
    wake : float
        Element size on the wake line, relative to the root of the distance from the trailing edge (the wake widens
        with that root); twice as much beyond a hundred chords. A coarse far wake reflects waves of low frequency.
    edge : float
        Size of the elements at the leading and the trailing edge, where the pressure goes as the inverse root of the
        distance.
    growth : float
        Grading of the mesher, 0 (slow growth of elements) to 1.

    Raises
    ------
    ValueError
        If a length is not positive, or they are not in the order ``edge < plate < domain``.
    """

    domain: float = 600.0
    plate: float = 0.03
    wake: float = 0.25
    edge: float = 1e-6
    growth: float = 0.4

    def __post_init__(self) -> None:
        for name in ("domain", "plate", "wake", "edge", "growth"):
            real_number(name, getattr(self, name), above=0.0)
        if not (0.0 < self.edge < self.plate < 0.5 and self.domain >= 5.0):
            raise ValueError(
                f"edge {self.edge:g}, plate {self.plate:g}, domain {self.domain:g} chords are out of order; "
                "0 < edge < plate < 0.5 and domain >= 5 are accepted"
            )
        if not 0.0 < self.growth <= 1.0:
            raise ValueError(f"growth is {self.growth:g}; give a grading above 0 and up to 1")


def check_incidence(incidence: Any) -> None:
    """Raise an error unless an angle of the stream to the plate is less than a quarter turn."""
    quarter = np.pi / 2.0
    real_number("incidence", incidence, above=-quarter, below=quarter, advice=": less than a quarter turn, in radians")


def half_mesh(settings: MeshSettings, *, incidence: float = 0.0) -> ngsolve.Mesh:
    """Return a triangular mesh of the half plane y > 0.

    Boundaries are named ``upper`` (the plate, 0 <= x <= 1), ``axis`` (y = 0 off the plate), ``inlet``, ``top`` and
    ``outlet``. The wake is refined along the direction of a stream at ``incidence`` (rad) to the plate.

    Raises
    ------
    ImportError
        If NGSolve is not installed.
    """
    instance_of("settings", settings, MeshSettings, "MeshSettings(plate=..., ...)")
    check_incidence(incidence)
    require_ngsolve()
    import ngsolve
    from netgen.geom2d import SplineGeometry
    from netgen.meshing import MeshingParameters

    far = settings.domain
    fan = settings.plate / 3.0
    geometry = SplineGeometry()
    x_axis = [-far, -fan, 0.0, fan, 1.0 - fan, 1.0, 1.0 + fan, 2.0 * far]
    corners = [*((x, 0.0) for x in x_axis), (2.0 * far, far), (-far, far)]
    points = [geometry.AppendPoint(*corner) for corner in corners]
    names = ["axis", "axis", "upper", "upper", "upper", "axis", "axis", "outlet", "top", "inlet"]
    for i, name in enumerate(names):
        geometry.Append(["line", points[i], points[(i + 1) % len(points)]], bc=name)
    for edge in (2, 5):
        _add_fan(geometry, points[edge - 1 : edge + 2], x_axis[edge], fan)
    parameters = MeshingParameters(maxh=far / 3.0, grading=settings.growth)
    for x in np.arange(0.0, 1.0 + 1e-9, settings.plate / 2.0):
        parameters.RestrictH(x, 0.0, 0.0, settings.plate)
    for x in (0.0, 1.0):
        parameters.RestrictH(x, 0.0, 0.0, fan)
    for x, h in _wake_sizes(settings):
        y = (x - 1.0) * np.tan(abs(incidence))
        if y < far:
            parameters.RestrictH(x, y, 0.0, h)
    mesh = ngsolve.Mesh(geometry.GenerateMesh(mp=parameters))
    _refine_edges(mesh, settings.edge)
    return mesh


def slit_mesh(settings: MeshSettings, *, incidence: float = 0.0) -> ngsolve.Mesh:
    """Return a triangular mesh of the plane with a slit along the plate: the half mesh and its mirror image.

    Boundaries are named ``upper`` and ``lower`` (the plate's sides, with nodes of their own, so that the pressure is
    double-valued), ``inlet``, ``top``, ``bottom`` and ``outlet``.
    """
    import ngsolve
    from netgen.meshing import Element1D, Element2D, FaceDescriptor, Mesh, MeshPoint, Pnt

    half = half_mesh(settings, incidence=incidence)
    whole = Mesh(dim=2)
    names = {"upper": 1, "lower": 2, "inlet": 3, "top": 4, "bottom": 5, "outlet": 6}
    whole.Add(FaceDescriptor(surfnr=1, domin=1, bc=1))
    for name, number in names.items():
        whole.SetBCName(number - 1, name)
    above, below = {}, {}
    for vertex in half.vertices:
        x, y = vertex.point
        number = vertex.nr
        above[number] = whole.Add(MeshPoint(Pnt(x, y, 0.0)))
        on_axis = abs(y) < 1e-12 and not 1e-12 < x < 1.0 - 1e-12
        below[number] = above[number] if on_axis else whole.Add(MeshPoint(Pnt(x, -y, 0.0)))
    for element in half.Elements(ngsolve.VOL):
        corners = [vertex.nr for vertex in element.vertices]
        whole.Add(Element2D(1, [above[c] for c in corners]))
        whole.Add(Element2D(1, [below[c] for c in reversed(corners)]))
    mirrored = {"upper": "lower", "top": "bottom"}
    for element in half.Elements(ngsolve.BND):
        if element.mat in {"axis", "inside"}:
            continue
        ends = [vertex.nr for vertex in element.vertices]
        whole.Add(Element1D([above[e] for e in ends], index=names[element.mat]))
        whole.Add(Element1D([below[e] for e in reversed(ends)], index=names[mirrored.get(element.mat, element.mat)]))
    return ngsolve.Mesh(whole)


def _add_fan(geometry: Any, on_axis: Sequence[int], x: float, radius: float) -> None:
    """Add four equal triangles around an edge of the plate.

    Left to itself the mesher may put slivers there, which bisection repeats down to the smallest element: loads on a
    mesh with slivers of aspect ratio 4 at the trailing edge were wrong by half a percent.
    """
    left, centre, right = on_axis
    angles = np.pi * np.array([0.75, 0.5, 0.25])
    rim = [geometry.AppendPoint(x + radius * np.cos(angle), radius * np.sin(angle)) for angle in angles]
    for point in rim:
        geometry.Append(["line", centre, point], leftdomain=1, rightdomain=1, bc="inside")
    for start, end in pairwise([left, *rim, right]):
        geometry.Append(["line", start, end], leftdomain=1, rightdomain=1, bc="inside")


def _wake_sizes(settings: MeshSettings) -> Iterator[tuple[float, float]]:
    x = 1.0
    while x < 2.0 * settings.domain:
        behind = x - 1.0
        root = np.sqrt(behind)
        h = settings.plate + min(0.2 * behind, settings.wake * max(root, min(0.18 * behind, 2.0 * root)))
        yield x, h
        x += h / 2.0


def _refine_edges(mesh: ngsolve.Mesh, size: float) -> None:
    """Bisect the elements at both edges until they are small: the mesher's own point size saturates near 1e-5."""
    import ngsolve

    edges = ((0.0, 0.0), (1.0, 0.0))
    while True:
        marked = 0
        for element in mesh.Elements(ngsolve.VOL):
            corners = np.array([mesh[vertex].point for vertex in element.vertices])
            at_edge = [corner for corner in corners if any(np.hypot(*(corner - edge)) < 1e-3 * size for edge in edges)]
            large = any(np.linalg.norm(corners - corner, axis=1).max() > size for corner in at_edge)
            mesh.SetRefinementFlag(element, large)
            marked += large
        if not marked:
            return
        mesh.Refine()
