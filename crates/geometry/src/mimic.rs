//! Mimic joints. In a URDF, a joint may follow another mimic joint. This module composes such chains, so that every
//! mimic joint is an affine function of an independent joint.

use crate::{Joint, Mimic, RobotError};

/// Replaces the source of each mimic joint by the independent joint at the end of its chain.
pub(crate) fn compose(joints: &mut [Joint]) -> Result<(), RobotError> {
    let composed: Vec<Option<Mimic>> = (0..joints.len()).map(|j| root(joints, j)).collect::<Result<_, _>>()?;
    for (joint, mimic) in joints.iter_mut().zip(composed) {
        joint.mimic = mimic;
    }
    Ok(())
}

fn root(joints: &[Joint], from: usize) -> Result<Option<Mimic>, RobotError> {
    let Some(mut out) = joints[from].mimic else { return Ok(None) };
    // A chain without a cycle visits each joint at most once.
    for _ in 0..joints.len() {
        let Some(next) = joints[out.source].mimic else {
            if !(out.multiplier.is_finite() && out.offset.is_finite()) {
                let field = format!("joint {}: mimic", joints[from].name);
                return Err(RobotError::new(field, "gives a multiplier that is not finite"));
            }
            return Ok(Some(out));
        };
        out = Mimic {
            source: next.source,
            multiplier: out.multiplier * next.multiplier,
            offset: out.multiplier * next.offset + out.offset,
        };
    }
    let field = format!("joint {}: mimic", joints[from].name);
    Err(RobotError::new(field, "is part of a cycle; make one joint of the cycle independent"))
}

#[cfg(test)]
mod tests {
    use crate::Robot;

    /// Three revolute joints in a row, each with the given mimic element; the last is declared first.
    fn arm(mimics: [&str; 3]) -> Result<Robot, crate::UrdfError> {
        let joint = |i: usize, mimic: &str| {
            format!(
                r#"<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{}"/><axis xyz="0 0 1"/>
                <limit lower="-2" upper="1" effort="1" velocity="1"/>{mimic}</joint>"#,
                i + 1
            )
        };
        let joints = [joint(2, mimics[2]), joint(1, mimics[1]), joint(0, mimics[0])].concat();
        let links: String = (0..4).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
        Robot::from_urdf_str(&format!(r#"<robot name="a">{links}{joints}</robot>"#), "a.urdf", None, "l3", None)
    }

    #[test]
    fn a_mimic_of_a_mimic_is_composed() {
        let robot = arm([
            r#"<mimic joint="j1" multiplier="2" offset="0.5"/>"#,
            r#"<mimic joint="j2" multiplier="-3" offset="0.1"/>"#,
            "",
        ])
        .unwrap();
        assert_eq!(robot.joints()[0].name, "j2");
        let mut q = [0.1, 7.0, 7.0];
        robot.apply_mimic(&mut q);
        assert!((q[1] - (-0.3 + 0.1)).abs() < 1e-12 && (q[2] - (2.0 * -0.2 + 0.5)).abs() < 1e-12, "{q:?}");
        // j0 = -6 j2 + 0.7 and j1 = -3 j2 + 0.1, each in [-2, 1].
        let (lower, upper) = robot.range(0).unwrap();
        assert!((lower - -0.05).abs() < 1e-12 && (upper - 0.45).abs() < 1e-12, "{lower} {upper}");
    }

    #[test]
    fn circles_are_refused() {
        let circle =
            [r#"<mimic joint="j1"/>"#, r#"<mimic joint="j2"/>"#, r#"<mimic joint="j0" multiplier="0.5" offset="1"/>"#];
        let error = arm(circle).unwrap_err();
        assert!(error.field.ends_with("mimic") && error.message.contains("cycle"), "{error}");
        assert!(arm([r#"<mimic joint="j0"/>"#, "", ""]).is_err());
        // The first joint follows a member of the cycle without being part of the cycle.
        assert!(arm([r#"<mimic joint="j1"/>"#, r#"<mimic joint="j2"/>"#, r#"<mimic joint="j1"/>"#]).is_err());
    }
}
