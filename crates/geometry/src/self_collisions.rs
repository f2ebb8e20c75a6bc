//! Distances between the links of a robot in random configurations. They show which links always overlap, because their
//! shapes are simplified, and which links are often close.

use std::fmt::Write;

use crate::collision::{MovingShapes, Scratch};
use crate::{Draws, JointKind, Robot};

/// Default number of random configurations.
pub const SAMPLES: usize = 1000;
/// Default fraction of the configurations above which links count as always overlapping, as in MoveIt's setup assistant.
pub const ALWAYS: f64 = 0.95;
/// Fraction of the configurations without an overlap above which links count as often closer than a margin, and the
/// largest margin (m) for which this holds. Links that meet by chance are closer than 5 mm in about 2 % of the
/// configurations, but many neighbouring links are often closer than 50 mm.
const OFTEN: f64 = 0.1;
const OFTEN_CLOSE: f64 = 0.01;
/// Number of random configurations for distances of links, and the number after which pairs are left out that were never
/// closer than [`OFTEN_CLOSE`].
const CLOSE_SAMPLES: usize = 400;
const FIRST: usize = 50;
/// Maximum distance (m) of links that are recorded as always close; no margin is larger.
const CLOSE: f64 = 0.1;
/// Purpose of the random numbers.
const PURPOSE: u64 = 0x7365_6c66;

/// Relation of two links over the configurations of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LinkRelation {
    /// A joint connects the links, or only links without shapes lie between them.
    Adjacent,
    /// The links overlap in almost all configurations.
    Always,
    /// The links overlap in some configurations.
    Sometimes,
    /// The links overlap in no sampled configuration. They may still overlap in others.
    Never,
}

impl LinkRelation {
    /// Name of the relation in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Adjacent => "adjacent",
            Self::Always => "always",
            Self::Sometimes => "sometimes",
            Self::Never => "never",
        }
    }
}

/// Two links with shapes, and how often they overlap.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LinkPair {
    /// Indices of the links, the lower first.
    pub links: (usize, usize),
    /// Relation of the links.
    pub relation: LinkRelation,
    /// Fraction of the sampled configurations in which the links overlap.
    pub fraction: f64,
    /// Whether motions are checked for collisions of the two links. Pairs that the robot's SRDF disables, adjacent links
    /// and links that always overlap are not checked.
    pub checked: bool,
}

/// Two links that are often close to each other.
#[derive(Debug, Clone)]
pub(crate) struct CloseLinks {
    /// Indices of the links, the lower first.
    pair: (usize, usize),
    /// Largest distance (m) in the closest tenth ([`OFTEN`]) of the sampled configurations without an overlap.
    often: f64,
    /// Largest distance (m) in all of these configurations; infinity if it is more than [`CLOSE`].
    always: f64,
}

impl Robot {
    /// Returns all pairs of links with shapes, and how often they overlap in random configurations within the joint
    /// limits. Joints without limits take values between -pi and pi, or between -1 m and 1 m. Links that overlap in at
    /// least the fraction `always` of the configurations get the relation [`LinkRelation::Always`].
    ///
    /// ```
    /// use gensim2_geometry::{ALWAYS, Convex, Joint, Link, LinkRelation, Pose, Robot, SAMPLES};
    /// use nalgebra::{Point3, Vector3};
    ///
    /// let ball = || Convex::ball(0.1, Point3::origin());
    /// let joint = |name: &str| Joint::revolute(name, Vector3::z()).limits(-1.0, 1.0).velocity(1.0);
    /// let robot = Robot::builder("arm")
    ///     .link(Link::base("base").shape(ball()?))
    ///     .link(Link::below("base", "elbow").moved_by(joint("j0")).shape(ball()?))
    ///     .link(Link::below("elbow", "hand").at(Pose::translation(0.1, 0.0, 0.0)).moved_by(joint("j1")).shape(ball()?))
    ///     .build("hand")?;
    /// let pairs = robot.self_collisions(SAMPLES, 0, ALWAYS);
    /// assert_eq!(pairs[1].relation, LinkRelation::Always); // base and hand overlap at every joint value
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn self_collisions(&self, samples: usize, seed: usize, always: f64) -> Vec<LinkPair> {
        let links = self.links();
        let adjacent = self.neighbours();
        let pairs: Vec<(usize, usize)> = (0..links.len())
            .flat_map(|a| (a + 1..links.len()).map(move |b| (a, b)))
            .filter(|(a, b)| !links[*a].shapes().is_empty() && !links[*b].shapes().is_empty())
            .collect();
        let mut overlaps = vec![0_usize; pairs.len()];
        self.survey(&pairs, samples, seed, 0.0, |pair, distance| {
            overlaps[pair] += usize::from(distance.is_some());
            true
        });
        let of_pair = |(pair, overlaps): (&(usize, usize), usize)| {
            let fraction = overlaps as f64 / samples.max(1) as f64;
            let relation = match () {
                () if adjacent.contains(pair) => LinkRelation::Adjacent,
                () if overlaps > 0 && fraction >= always => LinkRelation::Always,
                () if overlaps > 0 => LinkRelation::Sometimes,
                () => LinkRelation::Never,
            };
            let free = matches!(relation, LinkRelation::Adjacent | LinkRelation::Always);
            let checked = !free && self.allowed_pairs().binary_search(pair).is_err();
            LinkPair { links: *pair, relation, fraction, checked }
        };
        pairs.iter().zip(overlaps).map(of_pair).collect()
    }

    /// Returns an SRDF that disables the collision checks of all pairs in `pairs` that are not checked.
    #[must_use]
    pub fn srdf(&self, pairs: &[LinkPair]) -> String {
        let name = |link: usize| escaped(self.links()[link].name());
        let mut out = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escaped(self.name()));
        for pair in pairs.iter().filter(|pair| !pair.checked) {
            let reason = match pair.relation {
                LinkRelation::Adjacent => "Adjacent",
                LinkRelation::Always => "Always",
                LinkRelation::Sometimes | LinkRelation::Never => "User",
            };
            let (one, other) = (name(pair.links.0), name(pair.links.1));
            // Writing to a string cannot fail.
            let _ = writeln!(out, "  <disable_collisions link1=\"{one}\" link2=\"{other}\" reason=\"{reason}\"/>");
        }
        out + "</robot>\n"
    }

    /// Returns the pairs among `pairs` that overlap in at least the fraction [`ALWAYS`] of [`SAMPLES`] configurations.
    pub(crate) fn always_overlapping(&self, pairs: &[(usize, usize)]) -> Vec<(usize, usize)> {
        let most = ((1.0 - ALWAYS) * SAMPLES as f64).round() as usize;
        let mut apart = vec![0_usize; pairs.len()];
        self.survey(pairs, SAMPLES, 0, 0.0, |pair, distance| {
            apart[pair] += usize::from(distance.is_none());
            apart[pair] <= most
        });
        pairs.iter().zip(apart).filter(|(_, apart)| *apart <= most).map(|(pair, _)| *pair).collect()
    }

    /// Returns whether the shapes of two links (lower index first) prevent a `margin` (m, at most 0.1), so that a motion
    /// that kept it could not pass some values of the joints between them. The links are checked against each other, but
    /// closer than the margin in all random configurations in which they do not overlap, or closer than the margin and
    /// than 10 mm in at least a tenth of them.
    #[must_use]
    pub fn is_often_close(&self, pair: (usize, usize), margin: f64) -> bool {
        let close = self.often_close();
        close.binary_search_by_key(&pair, |links| links.pair).is_ok_and(|found| {
            let links = &close[found];
            links.often < margin.min(OFTEN_CLOSE) || links.always < margin
        })
    }

    /// Returns the checked pairs of links that are often or always close. Computed on first use.
    fn often_close(&self) -> &[CloseLinks] {
        self.close.0.get_or_init(|| {
            let pairs = crate::checked_pairs(self, |_, _| true);
            let (mut looks, mut seen) = (vec![0_usize; pairs.len()], vec![Vec::new(); pairs.len()]);
            let mut is_always = vec![true; pairs.len()];
            self.survey(&pairs, CLOSE_SAMPLES, 0, CLOSE, |pair, distance| {
                looks[pair] += 1;
                is_always[pair] &= distance.is_some();
                if distance.is_none_or(|d| d >= 0.0) {
                    seen[pair].push(distance.unwrap_or(f64::INFINITY));
                }
                looks[pair] != FIRST || is_always[pair] || seen[pair].iter().any(|d| *d < OFTEN_CLOSE)
            });
            let close = |(pair, mut seen): ((usize, usize), Vec<f64>)| {
                seen.sort_by(f64::total_cmp);
                let always = *seen.last()?;
                let often = seen[(OFTEN * seen.len() as f64).ceil() as usize - 1];
                (often < OFTEN_CLOSE || always < CLOSE).then_some(CloseLinks { pair, often, always })
            };
            pairs.into_iter().zip(seen).filter_map(close).collect()
        })
    }

    /// Calls `keep` for each pair of links in each random configuration, with the index of the pair and the distance of
    /// its links if the distance is less than `reach` (m). A pair for which `keep` returns false is left out of the
    /// remaining configurations.
    fn survey(
        &self,
        pairs: &[(usize, usize)],
        samples: usize,
        seed: usize,
        reach: f64,
        mut keep: impl FnMut(usize, Option<f64>) -> bool,
    ) {
        let shapes = MovingShapes::new(self.links().iter().map(|l| l.shapes()));
        let ranges: Vec<(f64, f64)> = (0..self.joints().len()).map(|j| self.sampled_range(j)).collect();
        let (mut draws, mut scratch) = (Draws::of(PURPOSE, seed), Scratch::default());
        scratch.set_early_exit(reach <= 0.0);
        let mut remaining: Vec<usize> = (0..pairs.len()).collect();
        let (mut q, mut groups, mut count) = (Vec::new(), Vec::new(), usize::MAX);
        for _ in 0..samples {
            if remaining.is_empty() {
                return;
            }
            if remaining.len() < count {
                count = remaining.len();
                groups = remaining.iter().flat_map(|pair| [pairs[*pair].0, pairs[*pair].1]).collect();
                groups.sort_unstable();
                groups.dedup();
            }
            q.clear();
            q.extend(ranges.iter().map(|(low, high)| low + (high - low) * draws.unit()));
            self.apply_mimic(&mut q);
            shapes.place(&groups, &mut scratch, |poses| self.place_links(&q, poses));
            let mut found = vec![None; pairs.len()];
            shapes.near_pairs(
                pairs,
                &remaining,
                &mut scratch,
                f64::INFINITY,
                |_| reach,
                |pair, near| {
                    found[pair] = Some(near.contact.distance);
                    true
                },
            );
            remaining.retain(|pair| keep(*pair, found[*pair]));
        }
    }

    /// Range of a joint's random values (rad or m); limits that do not exist are replaced.
    fn sampled_range(&self, j: usize) -> (f64, f64) {
        let joint = &self.joints()[j];
        let (lower, upper) = match self.range(j) {
            Some((lower, upper)) if lower <= upper => (lower, upper),
            _ => (joint.lower(), joint.upper()),
        };
        let wide = if joint.kind() == JointKind::Revolute { std::f64::consts::PI } else { 1.0 };
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) => (lower, upper),
            (true, false) => (lower, lower + 2.0 * wide),
            (false, true) => (upper - 2.0 * wide, upper),
            (false, false) => (-wide, wide),
        }
    }
}

/// Escapes a name for use in an XML attribute.
fn escaped(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => {
                let _ = write!(out, "&#{};", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::{ALWAYS, LinkRelation, SAMPLES};
    use crate::{Convex, Joint, Link, Pose, Robot};

    /// Returns an arm of three links in a plane; the third reaches back to the first if the elbow is bent far.
    fn arm(first_reach: f64) -> Robot {
        let bar = |length: f64, radius: f64| {
            let along = crate::pose_from_xyz_rpy([0.5 * length, 0.0, 0.0], [0.0, std::f64::consts::FRAC_PI_2, 0.0]);
            Convex::capsule(radius, length, &along).unwrap()
        };
        let joint = |name: &str| Joint::revolute(name, Vector3::z()).limits(-3.1, 3.1).velocity(1.0);
        Robot::builder("a \"b\" <c>")
            .link(Link::base("base").shape(Convex::ball(0.05, Point3::origin()).unwrap()))
            .link(Link::below("base", "upper & arm").moved_by(joint("j0")).shape(bar(0.5, 0.03)))
            .link(
                Link::below("upper & arm", "fore")
                    .at(Pose::translation(0.5, 0.0, 0.0))
                    .moved_by(joint("j1"))
                    .shape(bar(0.5, 0.03)),
            )
            .link(
                Link::below("upper & arm", "cover")
                    .at(Pose::translation(first_reach, 0.0, 0.0))
                    .moved_by(joint("j2"))
                    .shape(Convex::ball(0.02, Point3::origin()).unwrap()),
            )
            .build("fore")
            .unwrap()
    }

    #[test]
    fn pairs_are_adjacent_or_overlap_always_or_sometimes_or_never() {
        let robot = arm(0.06);
        let index = |name: &str| robot.link_index(name).unwrap();
        let relation = |robot: &Robot, one: &str, other: &str| {
            let (a, b) = (index(one).min(index(other)), index(one).max(index(other)));
            let pairs = robot.self_collisions(SAMPLES, 0, ALWAYS);
            let pair = pairs.into_iter().find(|p| p.links == (a, b)).unwrap();
            (pair.relation, pair.fraction, pair.checked)
        };
        assert_eq!(relation(&robot, "base", "upper & arm").0, LinkRelation::Adjacent);
        assert_eq!(relation(&robot, "base", "cover"), (LinkRelation::Always, 1.0, false));
        let (found, fraction, checked) = relation(&robot, "base", "fore");
        assert!(found == LinkRelation::Sometimes && fraction > 0.0 && fraction < 0.2 && checked, "{fraction}");
        let cover = (index("base"), index("cover"));
        assert_eq!(robot.unchecked_pairs(), [(cover.0.min(cover.1), cover.0.max(cover.1))]);
        // Links that were never seen to overlap are still checked.
        let far = arm(-0.2);
        assert_eq!(relation(&far, "base", "cover"), (LinkRelation::Never, 0.0, true));
        assert!(far.unchecked_pairs().is_empty());
    }

    #[test]
    fn links_whose_shapes_prevent_a_margin_are_often_close() {
        // The gap between base and cover is 0.073 - 0.05 - 0.02 m in every configuration.
        let robot = arm(0.073);
        let (base, cover) = (robot.link_index("base").unwrap(), robot.link_index("cover").unwrap());
        let pair = (base.min(cover), base.max(cover));
        assert!(robot.is_often_close(pair, 0.0031) && !robot.is_often_close(pair, 0.0029));
        assert!(!arm(0.2).is_often_close(pair, 0.1), "0.13 m are not close");
    }

    #[test]
    fn links_that_meet_by_chance_are_not_often_close() {
        // The forearm comes close to the base only if the elbow is bent far.
        let robot = arm(0.2);
        let (base, fore) = (robot.link_index("base").unwrap(), robot.link_index("fore").unwrap());
        let pair = (base.min(fore), base.max(fore));
        assert!(!robot.is_often_close(pair, 0.005) && !robot.is_often_close(pair, 0.1));
        let pairs = robot.self_collisions(SAMPLES, 0, ALWAYS);
        let found = pairs.iter().find(|found| found.links == pair).unwrap();
        assert!(found.checked && found.fraction > 0.0, "the links meet");
    }

    #[test]
    fn a_gap_that_varies_about_the_margin_is_often_closer_than_the_margin() {
        // A collar turns about an axis 1 mm beside the centre of a ball, so its gap varies between 4 and 6 mm.
        let joint = |name: &str| Joint::revolute(name, Vector3::z()).limits(-3.1, 3.1).velocity(1.0);
        let ball = |radius: f64, x: f64| Convex::ball(radius, Point3::new(x, 0.0, 0.0)).unwrap();
        let robot = Robot::builder("collar")
            .link(Link::base("base").shape(ball(0.05, 0.001)))
            .link(Link::below("base", "ring").moved_by(joint("j0")).shape(ball(0.01, 0.0)))
            .link(Link::below("ring", "collar").moved_by(joint("j1")).shape(ball(0.02, 0.075)))
            .build("collar")
            .unwrap();
        assert!(robot.is_often_close((0, 2), 0.005) && !robot.is_often_close((0, 2), 0.004));
        assert!(robot.is_often_close((0, 2), 0.05), "the gap is always smaller");
    }

    #[test]
    fn an_srdf_disables_the_same_pairs_and_the_seed_repeats_them() {
        let robot = arm(0.06);
        let pairs = robot.self_collisions(200, 3, ALWAYS);
        assert_eq!(pairs, robot.self_collisions(200, 3, ALWAYS));
        let text = robot.srdf(&pairs);
        assert!(text.contains("<robot name=\"a &quot;b&quot; &lt;c&gt;\">"), "{text}");
        assert!(text.contains("link1=\"base\" link2=\"upper &amp; arm\" reason=\"Adjacent\""), "{text}");
        assert!(text.contains("link1=\"base\" link2=\"cover\" reason=\"Always\""), "{text}");
        let known = robot.links().iter().map(Link::name).collect();
        let disabled = crate::srdf::disabled_pairs(&text, "SRDF", &known, robot.links()).unwrap();
        assert_eq!(disabled, robot.allowed_pairs());
    }
}
