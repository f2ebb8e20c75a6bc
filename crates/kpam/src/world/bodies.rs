//! The bodies of a scene, and the tree over them: built once, shared by all that is derived.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use gensim2_geometry::{Convex, Obstacles};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{Body, Role};

#[derive(Default)]
struct Shared {
    list: Vec<Body>,
    obstacles: OnceLock<Obstacles>,
}

/// Bodies and the tree over those that stand still. Clones share both.
#[derive(Clone, Default)]
pub struct Bodies(Arc<Shared>);

impl Bodies {
    /// Those that stand still, by their place in the list; attached bodies have no shapes there. Built when first asked
    /// for.
    pub(crate) fn obstacles(&self) -> &Obstacles {
        self.0.obstacles.get_or_init(|| {
            Obstacles::new(self.0.list.iter().map(|body| {
                let shapes: &[Convex] = if body.role == Role::Attached { &[] } else { &body.shapes };
                (shapes, &body.pose)
            }))
        })
    }

    /// Whether what tells of places begins at once, as [`crate::Scene::is_ready`].
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.0.obstacles.get().is_some()
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
