//! Pairs of links that an SRDF excludes from collision checks.

use std::collections::{BTreeSet, HashSet};

use crate::xml::{self, Element};
use crate::{Link, UrdfError};

const ELEMENTS: [&str; 10] = [
    "group",
    "group_state",
    "end_effector",
    "virtual_joint",
    "passive_joint",
    "joint_property",
    "link_sphere_approximation",
    "disable_collisions",
    "enable_collisions",
    "disable_default_collisions",
];

/// Returns the sorted pairs of links (lower index first) that are not checked: those of `disable_collisions`, and all
/// pairs with a link of `disable_default_collisions` except those of `enable_collisions`. `known` are the names of all
/// links in the URDF, of which `links` may be a part.
pub(crate) fn disabled_pairs(
    text: &str,
    file: &str,
    known: &HashSet<&str>,
    links: &[Link],
) -> Result<Vec<(usize, usize)>, UrdfError> {
    let document = xml::parse(text, file)?;
    let root = Element::root(&document, file);
    root.check_spelling(&ELEMENTS, &["name"])?;
    // A link above the chosen base is not part of this robot, so its collisions are not checked.
    let link = |element: &Element<'_>, attribute: &str| {
        let name = element.required(attribute)?;
        if known.contains(name) {
            return Ok(links.iter().position(|l| l.name() == name));
        }
        Err(element
            .wrong(attribute, format!("{name:?} is not a link of the robot; correct the name, or remove the line")))
    };
    let (mut of_links, mut off, mut on) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    for element in root.children()? {
        let element = element.called(element.name().to_owned());
        let pairs = match element.name() {
            "disable_collisions" => &mut off,
            "enable_collisions" => &mut on,
            "disable_default_collisions" => {
                element.check_spelling(&[], &["link"])?;
                of_links.extend(link(&element, "link")?);
                continue;
            }
            other => {
                if let Some(attribute) = element.attributes().find(|a| ["link1", "link2"].contains(a)) {
                    let message = format!("<{other}> with {attribute} is not known; write disable_collisions");
                    return Err(root.fail(message));
                }
                continue;
            }
        };
        element.check_spelling(&[], &["link1", "link2", "reason"])?;
        if let (Some(a), Some(b)) = (link(&element, "link1")?, link(&element, "link2")?) {
            pairs.insert((a.min(b), a.max(b)));
        }
    }
    for a in of_links {
        let others = (0..links.len()).filter(|b| *b != a).map(|b| (a.min(b), a.max(b)));
        off.extend(others.filter(|pair| !on.contains(pair)));
    }
    Ok(off.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use crate::{Robot, UrdfError};

    fn pairs(srdf: &str) -> Result<Vec<(usize, usize)>, UrdfError> {
        let links: String = (0..4).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
        let joint =
            |i: usize| format!(r#"<joint name="j{i}" type="fixed"><parent link="l0"/><child link="l{i}"/></joint>"#);
        let urdf = format!(r#"<robot name="a">{links}{}</robot>"#, [joint(1), joint(2), joint(3)].concat());
        let srdf = format!(r#"<robot name="a">{srdf}</robot>"#);
        let robot = Robot::from_urdf_str(&urdf, "a.urdf", Some(&srdf), "l3", None)?;
        Ok(robot.allowed_pairs().iter().copied().filter(|(a, _)| *a > 0).collect())
    }

    #[test]
    fn default_collisions_are_disabled_but_where_they_are_enabled_again() {
        assert_eq!(pairs("").unwrap(), []);
        assert_eq!(pairs(r#"<disable_collisions link1="l2" link2="l1"/>"#).unwrap(), [(1, 2)]);
        assert_eq!(pairs(r#"<disable_default_collisions link="l2"/>"#).unwrap(), [(1, 2), (2, 3)]);
        let some =
            r#"<disable_default_collisions link="l2"/><enable_collisions link1="l3" link2="l2"/><group name="g"/>"#;
        assert_eq!(pairs(some).unwrap(), [(1, 2)]);
    }

    #[test]
    fn what_is_misspelt_or_unknown_is_named() {
        for (srdf, named) in [
            (r#"<disable_collisionss link1="l1" link2="l2"/>"#, "disable_collisionss"),
            (r#"<ignore link1="l1" link2="l2"/>"#, "<ignore>"),
            (r#"<disable_collisions link1="l1" link2="link_3"/>"#, "\"link_3\""),
            (r#"<disable_collisions link1="l1"/>"#, "link2"),
            (r#"<disable_default_collisions link="l9"/>"#, "\"l9\""),
        ] {
            let error = pairs(srdf).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
