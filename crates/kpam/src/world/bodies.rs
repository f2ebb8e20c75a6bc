//! The bodies of a scene with their bounding volume hierarchy, built once and shared by derived scenes.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Convex, Obstacles, Robot};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{Body, ProblemError, Role};

#[derive(Default)]
struct Shared {
    list: Vec<Body>,
    obstacles: OnceLock<Obstacles>,
}

/// Bodies, and the bounding volume hierarchy over the fixed bodies. Clones share both.
#[derive(Clone, Default)]
pub struct Bodies(Arc<Shared>);

impl Bodies {
    /// Returns the fixed bodies by index in the list of bodies; attached bodies have no shapes here. Built on first
    /// use.
    pub(crate) fn obstacles(&self) -> &Obstacles {
        self.0.obstacles.get_or_init(|| {
            Obstacles::new(self.0.list.iter().map(|body| {
                let shapes: &[Convex] = if body.role == Role::Attached { &[] } else { &body.shapes };
                (shapes, &body.pose)
            }))
        })
    }

    /// Refuses names shared by two bodies, or by a body and a link, since messages use the names.
    pub(crate) fn check_names(&self, robot: &Robot) -> Result<(), ProblemError> {
        for (i, Body { name, .. }) in self.iter().enumerate() {
            let message = match () {
                () if self[..i].iter().any(|b| b.name == *name) => {
                    format!("{name:?} is used already; names must be unique")
                }
                () if robot.link_index(name).is_some() => format!("{name:?} is a link of the robot; rename the body"),
                () => continue,
            };
            return Err(ProblemError::new(format!("bodies[{i}].name"), message));
        }
        Ok(())
    }
}

impl From<Vec<Body>> for Bodies {
    fn from(list: Vec<Body>) -> Self {
        Self(Arc::new(Shared { list, obstacles: OnceLock::new() }))
    }
}

impl Deref for Bodies {
    type Target = [Body];

    fn deref(&self) -> &[Body] {
        &self.0.list
    }
}

impl std::fmt::Debug for Bodies {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl Serialize for Bodies {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.list.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Bodies {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::<Body>::deserialize(deserializer).map(Self::from)
    }
}
