"""The kinds of damage for the tests of object folders, one row each."""

from __future__ import annotations

import os
from pathlib import Path

from damage import (
    BOMB,
    CUBE_FACES,
    EXTERNAL,
    FIRST_TAG,
    LEFT,
    MIMIC_LOOP,
    Kind,
    chain_of_links,
    cut,
    inside,
    instead,
    joint,
    link_to,
    listen,
    outside,
    put,
    sparse,
    swap,
    told,
    twice_in_json,
    urdf,
)

KINDS = (
    # Not regular files
    Kind("no info.json", lambda folder: (folder / "info.json").unlink(), r"info\.json: cannot be read: No such file"),
    Kind("info.json is a pipe", instead("info.json", os.mkfifo), r"info\.json: is a pipe, not a file"),
    Kind("info.json is a folder", instead("info.json", Path.mkdir), r"info\.json: is a folder, not a file"),
    Kind("info.json leads to a device", instead("info.json", link_to("/dev/zero")), r"info\.json: lies outside"),
    Kind("URDF is a pipe", instead("mobility.urdf", os.mkfifo), r"mobility\.urdf: is a pipe, not a file"),
    Kind("URDF leads nowhere", instead("mobility.urdf", link_to("gone")), r"mobility\.urdf: cannot be read: No such"),
    Kind("URDF leads to itself", instead("mobility.urdf", link_to("mobility.urdf")), r"cannot be read: .*symbolic"),
    Kind("mesh is a pipe", instead(LEFT, os.mkfifo), r"urdf: link link_1: visual: .*left\.obj is a pipe, not a file"),
    Kind("mesh is a folder", instead(LEFT, Path.mkdir), r"link link_1: visual: .*left\.obj is a folder, not a file"),
    Kind("mesh is a socket", instead(LEFT, listen), r"link link_1: visual: .*left\.obj is a socket, not a file"),
    Kind("mesh leads to a device", instead(LEFT, link_to("/dev/zero")), r"left\.obj lies outside the folder"),
    Kind("mesh leads out of the folder", outside, r"left\.obj lies outside the folder \(copy it"),
    Kind("mesh leads elsewhere inside", inside),
    Kind(
        "mesh path goes up", urdf(LEFT, "../left.obj"), r"link link_1: visual: \.\./left\.obj lies outside the folder"
    ),
    Kind("mesh path is a device", urdf(LEFT, "/dev/zero.obj"), r"/dev/zero\.obj lies outside the folder"),
    Kind("mesh path is overlong", urdf(LEFT, "x" * 5000 + ".obj"), r"xxx\.\.\. cannot be read: File name too long"),
    Kind("mesh path is empty", urdf(LEFT, ""), r"mesh\.filename: is missing"),
    Kind("mesh is missing", lambda folder: (folder / LEFT).unlink(), None, r"1 mesh files missing: textured_objs/left"),
    Kind("mesh is an STL file", urdf(LEFT, "textured_objs/left.stl"), r"'.*left\.stl' is not an \.obj file \(convert"),
    Kind(
        "material file is a pipe",
        instead("textured_objs/left.mtl", os.mkfifo),
        r"left\.obj: mtllib: textured_objs/left\.mtl is a pipe",
    ),
    Kind(
        "material path goes up", swap(LEFT, "left.mtl", "../../../x.mtl"), r"left\.obj: mtllib: .*x\.mtl lies outside"
    ),
    Kind(
        "material file is missing", swap(LEFT, "left.mtl", "gone.mtl"), None, r"1 material files missing: .*gone\.mtl"
    ),
    Kind("a stray pipe lies in it", lambda folder: os.mkfifo(folder / "stray")),
    # Too large
    Kind("info.json is huge", instead("info.json", sparse(2**33)), r"info\.json: is larger than|holds over 512 MiB"),
    Kind("URDF is huge", instead("mobility.urdf", sparse(20 * 2**20)), r"mobility\.urdf: is larger than 16 MiB"),
    Kind("mesh is huge", instead(LEFT, sparse(40 * 2**20)), r"left\.obj is larger than 32 MiB"),
    Kind("folder is huge", lambda folder: sparse(2**40)(folder / "stray"), r"holds over 512 MiB"),
    Kind("50,001 elements", urdf("</robot>", "<x/>" * 50_001 + "</robot>"), r"urdf: has more than 50000 elements"),
    Kind(
        "nested 100,000 deep",
        urdf("</robot>", "<x>" * 10**5 + "</x>" * 10**5 + "</robot>"),
        r"more than 64 levels deep",
    ),
    Kind(
        "one mesh 10,000 times",
        urdf(
            "</robot>",
            '<link name="m">'
            + f'<visual><geometry><mesh filename="{LEFT}"/></geometry></visual>' * 10_000
            + "</link>"
            + joint("m", "base", "m")
            + "</robot>",
        ),
        None,
    ),
    Kind(
        "a face of 1,000,000 corners",
        put(LEFT, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 333_333),
        r"link link_1: collision: its meshes have over 2,000,000 triangles \(simplify",
    ),
    Kind(
        "3,000 materials",
        put(LEFT, "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(3000))),
        None,
        r"1 mesh files unreadable: .*has 3000 materials, more than 2000",
    ),
    Kind("chain of 5,000 links", chain_of_links(5_000)),
    Kind(
        "1,000 keypoints",
        told(keypoints={f"k{i}": [0, 0, 0] for i in range(1000)}),
        r"has 1000 keypoints, more than 256",
    ),
    # XML
    Kind("URDF is empty", put("mobility.urdf", ""), r"mobility\.urdf: not XML: no element found"),
    Kind("URDF is incomplete", cut("mobility.urdf", 0.6), r"mobility\.urdf: not XML"),
    Kind("URDF is binary", put("mobility.urdf", bytes(range(256)) * 40), r"mobility\.urdf: not XML"),
    Kind("URDF is not UTF-8", put("mobility.urdf", b'<robot name="\xff\xfe\xff"/>'), r"mobility\.urdf: not XML"),
    Kind(
        "URDF in no known encoding", put("mobility.urdf", '<?xml version="1.0" encoding="zz"?><a/>'), r"urdf: not XML"
    ),
    Kind(
        "entities expand", urdf(FIRST_TAG, BOMB.replace("<robot", "]><robot")), r"has a DOCTYPE, which a URDF does not"
    ),
    Kind("entity reads a file", urdf(FIRST_TAG, EXTERNAL), r"has a DOCTYPE, which a URDF does not"),
    # Tree
    Kind("two joints of one name", urdf('"joint_1"', '"joint_0"'), r"joint joint_0: two joints have this name"),
    Kind(
        "two links of one name", urdf("</robot>", '<link name="base"/></robot>'), r"link base: two links have this name"
    ),
    Kind("a link without a name", urdf('link name="link_1"', "link"), r"urdf: link: '' is no name"),
    Kind("a link named as a path", urdf("link_0", "../../../link_0", -1), r"link: .* is not a valid name \(1 to 100"),
    Kind(
        "a moving link named base",
        lambda folder: (urdf('"base"', '"root"', -1)(folder), urdf('"link_0"', '"base"', -1)(folder)),
        r"link base: the moving link must not be named 'base'",
    ),
    Kind("a joint without child", urdf('<child link="link_1"/>', ""), r"joint joint_1: a joint needs a parent and a"),
    Kind("a joint to no link", urdf('<child link="link_1"/>', '<child link="x"/>'), r"joint joint_1: no link 'x'"),
    Kind("two roots", urdf("</robot>", '<link name="lost"/></robot>'), r"has 2 root links instead of one"),
    Kind("links in a circle", urdf('<parent link="base"/>', '<parent link="link_0"/>'), r"joints form a loop"),
    Kind(
        "a link with two parents", urdf("</robot>", joint("x", "base", "link_1") + "</robot>"), r"the child of joint_1"
    ),
    Kind(
        "a loop apart",
        urdf("</robot>", '<link name="a"/><link name="b"/>' + joint("x", "a", "b") + joint("y", "b", "a") + "</robot>"),
        r"joint [xy]: joints form a loop",
    ),
    Kind(
        "joints that mimic each other",
        urdf("</robot>", MIMIC_LOOP),
        r"joint a: mimic: the joints mimic each other in a loop \(a -> b",
    ),
    Kind("a joint that mimics itself", urdf('<axis xyz="-1 0 0"/>', '<mimic joint="joint_0"/>'), r"mimic each other"),
    Kind(
        "a joint that mimics none", urdf('<axis xyz="-1 0 0"/>', '<mimic joint="x"/>'), r"joint_0: mimic: no joint 'x'"
    ),
    Kind(
        "it mimics a fixed joint",
        urdf('<axis xyz="-1 0 0"/>', '<mimic joint="joint_1"/>'),
        r"joint_1, which is a fixed joint",
    ),
    Kind("a joint of no type", urdf(' type="revolute"', ""), r"joint joint_0: type: unsupported type ''"),
    # Numbers in the URDF
    Kind("an origin that is NaN", urdf('xyz="0 0.2 -0.4"', 'xyz="0 nan 0"'), r"joint_0: origin\.xyz: not three finite"),
    Kind(
        "an origin at 1e30",
        urdf('xyz="0 0.2 -0.4"', 'xyz="0 1e30 0"'),
        r"origin\.xyz: contains a number of magnitude 1e\+30",
    ),
    Kind("two numbers", urdf('xyz="0 0.2 -0.4"', 'xyz="0 0.2"'), r"joint_0: origin\.xyz: not three finite"),
    Kind("a zero axis", urdf('"-1 0 0"', '"0 0 0"'), r"joint joint_0: axis: zero axis"),
    Kind("limits that are NaN", urdf('upper="2"', 'upper="nan"'), r"joint_0: limit\.upper: not one finite number"),
    Kind("limits that are words", urdf('lower="0"', 'lower="1 2"'), r"joint_0: limit\.lower: not one finite number"),
    Kind(
        "limits reversed",
        lambda folder: (urdf('upper="2"', 'upper="-2"')(folder), told(joint_position_range=None)(folder)),
        r"joint_0: limit: empty range \(lower and upper",
    ),
    *(
        Kind(f"mesh scale {value}", urdf("<mesh ", f'<mesh scale="{value}" '), pattern)
        for value, pattern in (
            ("0 1 1", r"visual: mesh\.scale: must be positive"),
            ("1 -1 1", r"visual: mesh\.scale: must be positive"),
            ("nan 1 1", r"visual: mesh\.scale: not three finite numbers"),
            ("2", r"visual: mesh\.scale: not three finite numbers"),
        )
    ),
    # info.json
    Kind("info.json is empty", put("info.json", ""), r"info\.json: not JSON: Expecting value"),
    Kind("info.json is incomplete", cut("info.json", 0.5), r"info\.json: not JSON"),
    Kind("info.json is a list", put("info.json", "[]"), r"info\.json: holds no fields"),
    Kind("info.json is not UTF-8", put("info.json", b'{"scale": "\xff"}'), r"info\.json: not JSON: 'utf-8' codec"),
    Kind("info.json is nested", put("info.json", "[" * 10**5), r"info\.json: not JSON: nested too deeply"),
    Kind(
        "a number of 5,000 digits", swap("info.json", "0.25", "9" * 5000, 1), r"info\.json: not JSON: Exceeds the limit"
    ),
    Kind("a field that is repeated", twice_in_json, r"info\.json: not JSON: field 'scale' is repeated"),
    Kind("a field that nobody knows", told(sclae=2), None, r"1 unknown fields of info\.json not used: sclae"),
    *(
        Kind(
            f"scale {value!r:.20}", told(scale=value), r"info\.json: scale: must be a positive number of plausible size"
        )
        for value in (0, -1.0, True, "0.25", [0.25], 1e30, 1e-30, 10**400, float("nan"), float("inf"))
    ),
    *(
        Kind(f"keypoint {value!r:.20}", told(keypoints={"a": value}), r"keypoints\.a: not three finite numbers")
        for value in ("abc", ["0", "0", "0"], [0, 0], [0, 0, True], [0, 0, 1e30], [0, 0, 10**400], {"x": 0}, None)
    ),
    Kind(
        "a keypoint far away",
        told(keypoints={"a": [0, 0, 100]}),
        r"keypoints\.a: the largest value of the keypoint is 25",
    ),
    Kind("a keypoint without a name", told(keypoints={"": [0, 0, 0]}), r"keypoints: '' is not a valid name"),
    Kind("a keypoint name of no text", told(keypoints={"\ud800\n": [0, 0, 0]}), r"keypoints: .* is not a valid name"),
    Kind("keypoints in a list", told(keypoints=[1, 2]), r"keypoints: no keypoints"),
    Kind("descriptions in a list", told(keypoint_descriptions=["a"]), r"keypoint_descriptions: must be a mapping"),
    Kind(
        "a description of no text",
        told(keypoint_descriptions={"a": "\ud800"}),
        r"descriptions\.a: .* cannot be printed",
    ),
    Kind("a range reversed", told(joint_position_range=[1, 0]), r"range: must be two increasing numbers"),
    Kind("a range of words", told(joint_position_range=["0", "1"]), r"joint_position_range: not two finite numbers"),
    Kind("a range of nothing", told(joint_position_range=[1, 1 + 1e-9]), r"range: must be two increasing"),
    Kind("an axis in a list", told(axis=["x"]), r"info\.json: axis: \['x'\] is not x, y or z"),
    Kind("a license that is a number", told(license=3), r"info\.json: license: the value 3 is not text"),
    # Meshes
    Kind("mesh is empty", put(LEFT, ""), None, r"1 mesh files unreadable: .*contains no triangle"),
    Kind("mesh is incomplete", cut(LEFT, 0.5), None, r"1 mesh files unreadable: .*a vertex has fewer than three"),
    Kind("mesh is binary", put(LEFT, bytes(range(256)) * 400), None, r"1 mesh files unreadable"),
    Kind("mesh is STL in disguise", put(LEFT, b"solid left\nfacet normal 0 0 1\n"), None, r"contains no triangle"),
    Kind("a vertex that is NaN", swap(LEFT, "-0.5", "nan"), None, r"vertex coordinate that is not a finite number"),
    Kind("a vertex at 1e30", swap(LEFT, "-0.5", "1e30"), None, r"has a vertex coordinate beyond 1e\+06"),
    Kind("vertices of two numbers", swap(LEFT, " 0.4\n", "\n"), None, r"1 mesh files unreadable"),
    Kind("a face that refers to 0", swap(LEFT, "f 1 4", "f 0 4"), None, r"refers to a vertex that does not exist"),
    Kind("a face that refers to 99", swap(LEFT, "f 1 4", "f 99 4"), None, r"refers to a vertex that does not exist"),
    Kind("a face that refers to 1e30", swap(LEFT, "f 1 4", f"f {10**30} 4"), None, r"refers to a vertex that does not"),
    Kind("a face that refers to -99", swap(LEFT, "f 1 4", "f -99 4"), None, r"refers to a vertex that does not exist"),
    Kind("a face of two corners", swap(LEFT, "f 1 4 3 2", "f 1 4"), None, r"a face has fewer than three corners"),
    Kind("lines end as in DOS", swap(LEFT, "\n", "\r\n")),
    Kind("lines are continued", swap(LEFT, "f 1 4 3 2", "f 1 4 \\\n3 2")),
    Kind(
        "words are parted by tabs", lambda folder: (swap(LEFT, "v ", "\tv\t")(folder), swap(LEFT, "f ", "f\t")(folder))
    ),
    Kind("faces count backwards", swap(LEFT, CUBE_FACES, "f -8 -5 -6 -7\n" + CUBE_FACES.split("\n", 1)[1])),
    Kind("faces with normals and textures", swap(LEFT, "f 1 4 3 2", "f 1/1/1 4//2 3/3 2")),
    Kind("a face of eight corners", swap(LEFT, "f 4 1 5 8", "f 4 1 1 1 5 5 5 8")),
    Kind(
        "a colour that is NaN", put("textured_objs/left.mtl", "newmtl paint\nKd nan 0 0\n"), None, r"colour that is no"
    ),
    Kind("materials that are binary", put("textured_objs/left.mtl", bytes(range(256)) * 40)),
    Kind(
        "a lid of no volume", put("textured_objs/lid.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"), r"no collision geom"
    ),
    Kind(
        "a lid that is missing",
        lambda folder: (folder / "textured_objs/lid.obj").unlink(),
        r"no collision geometry \(1",
    ),
    Kind(
        "no body",
        lambda folder: [
            (folder / f"textured_objs/{n}.obj").unlink() for n in ("floor", "left", "right", "back", "front")
        ],
        None,
        r"5 mesh files missing",
    ),
)
