"""USD files become the objects that the same URDF describes; hostile files are refused with one line."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

pytest.importorskip("pxr")

from pxr import Usd

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.objects import ArticulatedObject, open_library
from gensim2.objects.library import usd
from gensim2.objects.library.folder import ObjectFolder, find_source
from gensim2.objects.library.importer import import_object
from gensim2.objects.library.urdf import link_inertial, read_urdf

URDF = """
<robot name="cabinet">
  <link name="cabinet">
    <inertial><origin xyz="0 0 0.1"/><mass value="2"/>
      <inertia ixx="0.03" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.2 0.2 0.4"/></geometry><material name="a"><color rgba="1 0 0 1"/></material></visual>
    <collision><geometry><box size="0.2 0.2 0.4"/></geometry></collision>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="cabinet"/><child link="door"/><origin xyz="-0.11 0.1 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="2" effort="0" velocity="0"/>
  </joint>
  <link name="door">
    <visual><origin xyz="0 -0.1 0"/><geometry><box size="0.02 0.2 0.4"/></geometry></visual>
    <visual><origin xyz="-0.02 -0.18 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.01" length="0.03"/>
      </geometry></visual>
    <collision><origin xyz="0 -0.1 0"/><geometry><box size="0.02 0.2 0.4"/></geometry></collision>
    <collision><origin xyz="-0.02 -0.18 0" rpy="0 1.5707963267948966 0"/><geometry>
      <cylinder radius="0.01" length="0.03"/></geometry></collision>
  </link>
</robot>
"""
"""A cabinet whose door is hinged on its left; lengths in metres."""

USDA = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.01
    kilogramsPerUnit = 0.001
    upAxis = "Z"
)
def Xform "World"
{
    double3 xformOp:translate = (300, -20, 7)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Plane "ground" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}
    def PhysicsScene "scene" {}
    def Xform "cabinet" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    {
        float physics:mass = 2000
        point3f physics:centerOfMass = (0, 0, 10)
        float3 physics:diagonalInertia = (300000, 200000, 100000)
        def Cube "body" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            double size = 1
            color3f[] primvars:displayColor = [(1, 0, 0)]
            double3 xformOp:scale = (20, 20, 40)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
    }
    def Xform "door" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
    {
        double3 xformOp:translate = (-11, 10, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "panel" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            double3 xformOp:translate = (0, -10, 0)
            float3 xformOp:scale = (1, 10, 20)
            uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        }
        def Cylinder "knob" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            token axis = "X"
            double radius = 1
            double height = 3
            double3 xformOp:translate = (-2, -18, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def PhysicsFixedJoint "anchor"
    {
        rel physics:body1 = </World/cabinet>
    }
    def PhysicsRevoluteJoint "hinge"
    {
        rel physics:body0 = </World/cabinet>
        rel physics:body1 = </World/door>
        uniform token physics:axis = "Z"
        point3f physics:localPos0 = (-11, 10, 0)
        quatf physics:localRot0 = (1, 0, 0, 0)
        point3f physics:localPos1 = (0, 0, 0)
        quatf physics:localRot1 = (1, 0, 0, 0)
        float physics:lowerLimit = -5.729577951308232
        float physics:upperLimit = 114.59155902616465
    }
}
"""


def imported(file: Path, name: str = "a") -> ArticulatedObject:
    import_object(file, file.parent / "library", "cabinet", name, scale=1.0)
    return open_library(file.parent / "library").load_articulated("cabinet", name)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    file = tmp_path / "cabinet.usda"
    file.write_text(USDA)
    return file


@pytest.fixture(scope="module")
def wanted(tmp_path_factory: pytest.TempPathFactory) -> ArticulatedObject:
    """The object that the URDF describes."""
    file = tmp_path_factory.mktemp("urdf") / "cabinet.urdf"
    file.write_text(URDF)
    return imported(file)


def swap(*pairs: tuple[str, str]) -> Callable[[str], str]:
    def change(text: str) -> str:
        for one, other in pairs:
            assert one in text
            text = text.replace(one, other)
        return text

    return change


HALF = 0.7071067811865476

SAME = {
    "as written": swap(),
    "stored with the door open by 90 degrees": swap(
        (
            "double3 xformOp:translate = (-11, 10, 0)",
            "double3 xformOp:translate = (-11, 10, 0)\nfloat xformOp:rotateZ = 90",
        ),
        (
            '["xformOp:translate"]\n        def Cube "panel"',
            '["xformOp:translate", "xformOp:rotateZ"]\n        def Cube "panel"',
        ),
    ),
    "with an axis X turned to z": swap(
        ('physics:axis = "Z"', 'physics:axis = "X"'),
        ("localRot0 = (1, 0, 0, 0)", f"localRot0 = ({HALF}, 0, {-HALF}, 0)"),
        ("localRot1 = (1, 0, 0, 0)", f"localRot1 = ({HALF}, 0, {-HALF}, 0)"),
    ),
    "with the bodies of the hinge exchanged": swap(
        ("body0 = </World/cabinet>", "body0 = </World/none>"),
        ("body1 = </World/door>", "body1 = </World/cabinet>"),
        ("body0 = </World/none>", "body0 = </World/door>"),
        ("localPos0 = (-11, 10, 0)", "localPos0 = (0, 0, 0)"),
        ("localPos1 = (0, 0, 0)", "localPos1 = (-11, 10, 0)"),
        ("lowerLimit = -5.729577951308232", "lowerLimit = -114.59155902616465"),
        ("upperLimit = 114.59155902616465", "upperLimit = 5.729577951308232"),
        (
            '["PhysicsRigidBodyAPI", "PhysicsMassAPI"]',
            '["PhysicsRigidBodyAPI", "PhysicsMassAPI", "PhysicsArticulationRootAPI"]',
        ),
    ),
    "with a static cabinet": swap(
        ('["PhysicsRigidBodyAPI", "PhysicsMassAPI"]', '["PhysicsMassAPI"]'),
    ),
    "with a body in inches": swap(
        ("double3 xformOp:scale = (20, 20, 40)", "double3 xformOp:scale = (7.874015748, 7.874015748, 15.748031496)"),
        (
            'uniform token[] xformOpOrder = ["xformOp:translate"]\n    def Plane',
            "double3 xformOp:scale = (2.54, 2.54, 2.54)\nuniform token[] xformOpOrder = "
            '["xformOp:translate", "xformOp:scale"]\n    def Plane',
        ),
        ("(-11, 10, 0)", "(-4.330708661, 3.937007874, 0)"),
        ("(0, -10, 0)", "(0, -3.937007874, 0)"),
        ("float3 xformOp:scale = (1, 10, 20)", "float3 xformOp:scale = (0.3937007874, 3.937007874, 7.874015748)"),
        ("radius = 1", "radius = 0.3937007874"),
        ("height = 3", "height = 1.1811023622"),
        ("(-2, -18, 0)", "(-0.7874015748, -7.0866141732, 0)"),
    ),
    "with y up and the front facing z": swap(
        ('upAxis = "Z"', 'upAxis = "Y"'),
        # Turn the World so that its z points along y, and its -x along z.
        (
            'uniform token[] xformOpOrder = ["xformOp:translate"]\n    def Plane',
            "matrix4d xformOp:transform = ((0, 0, -1, 0), (-1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1))\n"
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:transform"]\n    def Plane',
        ),
    ),
}
"""Changes of the file after which it still describes the same object."""


@pytest.mark.parametrize("change", SAME.values(), ids=SAME.keys())
def test_the_same_object_as_usd_and_as_urdf(
    change: Callable[[str], str], written: Path, wanted: ArticulatedObject
) -> None:
    written.write_text(change(USDA))
    found = imported(written)
    assert found.joint.type == wanted.joint.type == "revolute"
    for limit in ("lower", "upper", "friction", "damping"):
        np.testing.assert_allclose(getattr(found.joint, limit), getattr(wanted.joint, limit), rtol=1e-4, err_msg=limit)
    assert len(found.hulls) == len(wanted.hulls) == 2
    for q in (wanted.joint.lower, 0.0, 0.7, wanted.joint.upper):
        # Where the corners of both links are, which no choice of link frames changes.
        places = [_corners(each, q) for each in (found, wanted)]
        np.testing.assert_allclose(places[0], places[1], atol=2e-6)
    np.testing.assert_allclose(found.mass, wanted.mass, rtol=1e-5)


def _corners(model: ArticulatedObject, q: float) -> np.ndarray:
    """Return the corners (L, 2, 3) of the bounding boxes of the links, at a joint value, in the root frame."""
    still = [hull for link, hulls in model.hulls.items() if link != model.joint.child_link for hull in hulls]
    T = model.joint.T_root_child_at(q)
    moving = [hull @ T[:3, :3].T + T[:3, 3] for hull in model.hulls[model.joint.child_link]]
    return np.stack([[np.concatenate(each).min(axis=0), np.concatenate(each).max(axis=0)] for each in (still, moving)])


def stored(file: Path, name: str = "a") -> ObjectFolder:
    return ObjectFolder(file.parent / "library/articulated_objs/cabinet" / name)


def test_masses_inertias_and_colours_are_converted(written: Path) -> None:
    imported(written)
    urdf = read_urdf(stored(written))
    inertial = link_inertial(urdf, "cabinet")
    assert inertial is not None
    assert inertial.mass == pytest.approx(2.0)
    np.testing.assert_allclose(inertial.center, [0, 0, 0.1], atol=1e-9)
    np.testing.assert_allclose(inertial.inertia, np.diag([0.03, 0.02, 0.01]), atol=1e-9)
    assert link_inertial(urdf, "door") is None
    text = stored(written).read("mobility.urdf").decode()
    assert 'rgba="1 0 0 1"' in text
    written.write_text(
        USDA.replace("float physics:mass = 2000", "float physics:density = 1").replace("diagonalInertia", "other")
    )
    imported(written, "b")  # 1 g/cm³
    inertial = link_inertial(read_urdf(stored(written, "b")), "cabinet")
    assert inertial is not None
    assert inertial.mass == pytest.approx(0.2 * 0.2 * 0.4 * 1000)
    np.testing.assert_allclose(inertial.inertia[2, 2], inertial.mass * (0.2**2 + 0.2**2) / 12, rtol=1e-3)


MESH = """
        def Mesh "wedge" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"])
        {
            uniform token physics:approximation = "APPROXIMATION"
            uniform token orientation = "leftHanded"
            point3f[] points = [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (0, 0, 6), (4, 0, 6)]
            int[] faceVertexCounts = [4, 4, 4, 3, 3]
            int[] faceVertexIndices = [0, 1, 2, 3, 0, 4, 5, 1, 4, 3, 2, 5, 0, 3, 4, 1, 5, 2]
            double3 xformOp:scale = (-1, 1, 1)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
"""


@pytest.mark.parametrize("approximation", ["convexHull", "none"])
def test_meshes_are_triangulated_and_face_outwards(approximation: str, written: Path) -> None:
    mesh = MESH.replace("APPROXIMATION", approximation)
    written.write_text(USDA.replace('        def Cube "panel"', f'{mesh}        def Cube "panel"'))
    found, is_convex = usd.convert(written, written.parent)
    assert is_convex == (approximation == "convexHull")
    visual, collision = (trimesh.load(found.parent / f"mesh_{number}.obj", process=False) for number in range(2))
    for each in (visual, collision):
        assert each.is_volume
        assert each.volume == pytest.approx(0.04 * 0.04 * 0.06 / 2)
        np.testing.assert_allclose(each.bounds, [[-0.04, 0, 0], [0, 0.04, 0.06]], atol=1e-9)
    assert len(visual.faces) == 8
    assert len(imported(written).hulls["door"]) == 3 or not is_convex  # other meshes are decomposed


def test_slides_capsules_spheres_and_cones(written: Path) -> None:
    shapes = """
        def Capsule "c" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            token axis = "Y"
            double radius = 1
            double height = 4
        }
        def Sphere "s" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            double radius = 2
        }
        def Cone "k" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            double radius = 3
            double height = 5
            token axis = "X"
        }
        def Sphere "egg" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            double radius = 1
            double3 xformOp:scale = (1, 2, 3)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
"""
    text = USDA.replace("PhysicsRevoluteJoint", "PhysicsPrismaticJoint").replace(
        "upperLimit = 114.59", "upperLimit = 20 #"
    )
    written.write_text(text.replace('        def Cube "panel"', f'{shapes}        def Cube "panel"'))
    found = imported(written)
    assert found.joint.type == "prismatic"
    assert found.joint.upper == pytest.approx(0.2)
    boxes = [np.ptp(hull, axis=0) for hull in found.hulls["door"]]
    for wanted_box in ([0.02, 0.06, 0.02], [0.04] * 3, [0.05, 0.06, 0.06], [0.02, 0.04, 0.06]):
        assert any(np.abs(box - wanted_box).max() < 2e-3 for box in boxes), wanted_box


def test_binary_files_packages_and_references(written: Path, wanted: ArticulatedObject) -> None:
    Usd.Stage.Open(str(written)).Export(str(written.with_suffix(".usdc")))
    (written.parent / "outer.usda").write_text(
        '#usda 1.0\n(metersPerUnit = 0.01\n upAxis = "Z"\n kilogramsPerUnit = 0.001)\n'
        'def "Room" (prepend references = @parts/../cabinet.usdc@</World>) {}\n'
    )
    (written.parent / "parts").mkdir()
    with zipfile.ZipFile(written.parent / "whole.usdz", "w") as archive:
        archive.write(written.parent / "outer.usda", "outer.usda")
        archive.write(written.with_suffix(".usdc"), "cabinet.usdc")
    for number, name in enumerate(("cabinet.usdc", "outer.usda", "whole.usdz")):
        found = imported(find_source(str(written.parent / name)), str(number))
        np.testing.assert_allclose(_corners(found, 0.5), _corners(wanted, 0.5), atol=2e-6)


HEAD = '    def PhysicsScene "scene" {}'


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (swap((HEAD, 'def "a" (references = @../secret.usda@) {}')), "lies outside the folder"),
        (swap((HEAD, 'def "a" (references = @/etc/passwd@) {}')), "is not a relative path"),
        (swap((HEAD, 'def "a" (payload = @http://localhost/a.usda@) {}')), "is not a relative path"),
        (swap((HEAD, 'def "a" (references = @a.usdz[b.usda]@) {}')), "is not a relative path"),
        (swap((HEAD, 'def "a" (references = @`"../" + "secret.usda"`@) {}')), "is not a relative path"),
        (swap((HEAD, 'def "a" (references = @x.usda:SDF_FORMAT_ARGS:a=b@) {}')), "is not a relative path"),
        (swap((HEAD, 'def "a" (references = @gone.usda@) {}')), "gone.usda: cannot be read: No such file"),
        (swap((HEAD, 'def "a" (references = @link.usda@) {}')), "lies outside the folder"),
        (swap((HEAD, 'def "a" (references = @mesh.abc@) {}')), "is not a USD file"),
        (swap(("metersPerUnit = 0.01", "metersPerUnit = 0.01\nsubLayers = [@../secret.usda@]")), "outside the folder"),
        (
            swap(
                (
                    HEAD,
                    'def "a" (variants = {string v = "x"}\nvariantSets = "v") {\n'
                    'variantSet "v" = {\n"x" (payload = @../secret.usda@) {}\n}\n}',
                )
            ),
            "outside the folder",
        ),
        (swap((HEAD, 'def "a" (references = </World>) {}')), "the USD stage cannot be composed"),
        (swap((HEAD, 'def PointInstancer "a" {}')), None),
        (swap(('def Cube "panel"', 'def PointInstancer "panel"')), "has a type that cannot be imported"),
        (swap(('def Cube "panel"', 'def Cone_x "panel"')), None),
        (swap(('def Cylinder "knob"', 'def Cylinder_1 "knob"')), "has a type that cannot be imported"),
        (swap(("double radius = 1", "double radius = nan")), "radius: must be a positive number, but is nan"),
        (swap(("double size = 1", "double size = -1")), "size: must be a positive number, but is -1"),
        (swap(("(300, -20, 7)", "(inf, 0, 0)")), "has no finite transform"),
        (swap(("localRot0 = (1, 0, 0, 0)", "localRot0 = (nan, 0, 0, 0)")), "not finite"),
        (swap(("localRot0 = (1, 0, 0, 0)", "localRot0 = (1e-20, 0, 0, 0)")), "not a rotation"),
        (swap(("metersPerUnit = 0.01", "metersPerUnit = 0")), "metersPerUnit: must lie between"),
        (swap(("kilogramsPerUnit = 0.001", "kilogramsPerUnit = -1")), "kilogramsPerUnit: must lie between"),
        (swap(("PhysicsRevoluteJoint", "PhysicsSphericalJoint")), "is a PhysicsSphericalJoint"),
        (swap(("PhysicsRevoluteJoint", "PhysicsFixedJoint")), "exactly one object with moving joints, but contains 0"),
        (swap(("lowerLimit = -5.7", "lowerLimit = 999 #")), "exactly one object with moving joints, but contains 0"),
        (swap(('physics:axis = "Z"', 'physics:axis = "W"')), "must be X, Y or Z"),
        (swap(("physics:mass = 2000", "physics:mass = nan")), "is out of range"),
        (swap(("</World/door>", "</World/nobody>")), "must name one existing prim"),
        (swap(("#usda 1.0", "#usda 9.0")), "USD cannot read cabinet.usda"),
        (swap(("#usda 1.0", "PXR-USDC\0\0\0")), "USD cannot read cabinet.usda"),
        (swap((USDA, "")), "USD cannot read cabinet.usda"),
        (lambda text: text + 'def "a" {' * 100_000, "USD cannot read cabinet.usda|crashed"),
    ],
)
def test_hostile_files_are_refused_with_one_line(written: Path, change: Callable[[str], str], said: str | None) -> None:
    (written.parents[1] / "secret.usda").write_text("#usda 1.0\n")
    (written.parent / "link.usda").symlink_to("../secret.usda")
    written.write_text(change(USDA))
    if said is None:
        imported(written)
        return
    with pytest.raises(InputError, match=said) as refused:
        imported(written)
    assert "\n" not in str(refused.value)
    assert not list(written.parent.glob("library/articulated_objs/cabinet/*"))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("../a.usda", "lies outside the package"),
        ("/a.usda", "is not a relative path"),
        ("a.txt", "the first file in the package"),
    ],
)
def test_a_hostile_package_is_refused(name: str, said: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.usdz", "w") as archive:
        archive.writestr(name, USDA)
    with pytest.raises(InputError, match=said):
        imported(tmp_path / "a.usdz")
    assert [path.name for path in tmp_path.parent.glob("a.usda")] == []
    (tmp_path / "b.usdz").write_bytes(b"PK no zip")
    with pytest.raises(InputError, match="is not a usdz package"):
        imported(tmp_path / "b.usdz")


def test_references_that_double_reach_a_limit(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    doubled = "".join(
        f'def "x{n}" {{\ndef "a" (references = </x{n + 1}>) {{}}\ndef "b" (references = </x{n + 1}>) {{}}\n}}\n'
        for n in range(40)
    )
    written.write_text(USDA + doubled + 'def "x40" {}\n')
    monkeypatch.setattr(usd, "CPU_S", 5)
    with pytest.raises(InputError, match=r"MiB of memory|s of CPU|over 100000 prims|crashed") as refused:
        imported(written)
    assert "\n" not in str(refused.value)


def test_the_up_axis_comes_from_the_file(written: Path) -> None:
    with pytest.raises(InputError, match="up: this option does not apply to a USD file"):
        import_object(written, written.parent / "library", "cabinet", "a", up="y")


def test_the_extra_is_named(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usd, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"usd-core is not installed \(pip install 'gensim2\[usd\]'\)"):
        imported(written)
