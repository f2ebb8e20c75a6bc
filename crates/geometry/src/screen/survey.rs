//! Lower bounds of all distances of eight configurations.

use nalgebra::Point3;
use wide::f32x8;

use super::solid::{Points, length};
use super::{Batch, LANES, Needs, Other, Screen, Suspect};
use crate::{Aabb, Robot};

impl Screen {
    /// Poses the balls of a batch whose lanes are set.
    pub fn place(&self, batch: &mut Batch) {
        self.posing.place(&batch.q, &mut batch.frames);
        batch.around.clear();
        batch.around.extend(self.groups.iter().map(|g| batch.frames[g.link].point(&g.around.center)));
        batch.centers.resize(self.balls.len(), [f32x8::ZERO; 3]);
        batch.ready.clear();
        batch.ready.resize(self.groups.len(), false);
    }

    fn ensure(&self, group: usize, batch: &mut Batch) {
        if !batch.ready[group] {
            let cluster = &self.groups[group];
            let frame = batch.frames[cluster.link];
            for b in cluster.balls.clone() {
                batch.centers[b] = frame.point(&self.balls[b].center);
            }
            batch.ready[group] = true;
        }
    }

    /// Calls `visit` for everything that some lane may be nearer to than is needed and `reach` (m) more. It returns
    /// whether to go on.
    pub fn survey(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        reach: f32,
        mut visit: impl FnMut(&Suspect) -> bool,
    ) -> bool {
        for group in 0..self.groups.len() {
            let cluster = &self.groups[group];
            if cluster.balls.is_empty() {
                continue;
            }
            let row = &needs.bodies[group * self.bodies..(group + 1) * self.bodies];
            let furthest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if furthest == f64::NEG_INFINITY {
                continue;
            }
            match &self.tree {
                None => {
                    for e in 0..self.solids.len() {
                        if !self.against_solid(group, e, row[self.body_of[e]], batch, reach, &mut visit) {
                            return false;
                        }
                    }
                }
                Some(tree) => {
                    let bounds = region(&batch.around[group], cluster.around.radius);
                    let mut near = std::mem::take(&mut batch.near);
                    near.clear();
                    tree.near(&bounds, (furthest + f64::from(reach)).max(0.0), |e| near.push(e as u32));
                    let whole = near.iter().all(|e| {
                        let e = *e as usize;
                        self.against_solid(group, e, row[self.body_of[e]], batch, reach, &mut visit)
                    });
                    batch.near = near;
                    if !whole {
                        return false;
                    }
                }
            }
            for (c, cloud) in self.clouds.iter().enumerate() {
                if !self.against_cloud(group, c, row[cloud.body], batch, reach, &mut visit) {
                    return false;
                }
            }
        }
        (0..self.pairs.len()).all(|pair| self.against_group(pair, needs.pairs[pair], batch, reach, &mut visit))
    }

    fn against_solid(
        &self,
        group: usize,
        e: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (solid, cluster, need) = (&self.solids[e], &self.groups[group], need as f32);
        let limit = f32x8::splat(reach + need);
        let coarse = solid.distance(&batch.around[group]) - f32x8::splat(cluster.around.radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(group, batch);
        let own = cluster.balls.clone();
        let [least, inner] = solid.least(&batch.centers[own.clone()], &self.balls[own]);
        // Neither bound is above the distance: the greater counts.
        let bound = least.fast_max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        let most = (inner + f32x8::splat(self.looseness[e] - need)).to_array();
        visit(&Suspect { group, other: Other::Element(e), gap: (bound - f32x8::splat(need)).to_array(), most })
    }

    fn against_cloud(
        &self,
        group: usize,
        c: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (cloud, cluster, need) = (&self.clouds[c], &self.groups[group], need as f32);
        let limit = reach + need;
        let each = |p: &Points, radius: f32| {
            let [x, y, z] = [p[0].to_array(), p[1].to_array(), p[2].to_array()];
            std::array::from_fn::<f32, LANES, _>(|l| cloud.distance([x[l], y[l], z[l]]) - radius)
        };
        let coarse = each(&batch.around[group], cluster.around.radius);
        if coarse.iter().all(|d| *d >= limit) {
            return true;
        }
        self.ensure(group, batch);
        let mut bound = [f32::MAX; LANES];
        for b in cluster.balls.clone() {
            let found = each(&batch.centers[b], self.balls[b].radius);
            for (least, d) in bound.iter_mut().zip(found) {
                *least = least.min(d);
            }
        }
        for (b, d) in bound.iter_mut().zip(coarse) {
            *b = b.max(d);
        }
        if bound.iter().all(|d| *d >= limit) {
            return true;
        }
        visit(&Suspect { group, other: Other::Cloud(c), gap: bound.map(|d| d - need), most: [f32::MAX; LANES] })
    }

    fn against_group(
        &self,
        pair: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut impl FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (a, b) = self.pairs[pair];
        let (one, two, need) = (&self.groups[a], &self.groups[b], need as f32);
        let limit = f32x8::splat(reach + need);
        let apart =
            |p: &Points, q: &Points, radii: f32| length(&[p[0] - q[0], p[1] - q[1], p[2] - q[2]]) - f32x8::splat(radii);
        let coarse = apart(&batch.around[a], &batch.around[b], one.around.radius + two.around.radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(a, batch);
        self.ensure(b, batch);
        // Balls of the second that come near the first at all.
        let mut open = std::mem::take(&mut batch.open);
        open.clear();
        for k in two.balls.clone() {
            let d = apart(&batch.centers[k], &batch.around[a], self.balls[k].radius + one.around.radius);
            open.push(!all_at_least(d, limit));
        }
        let mut least = f32x8::splat(reach + need);
        let mut inner = f32x8::splat(f32::MAX);
        for i in one.balls.clone() {
            let d = apart(&batch.centers[i], &batch.around[b], self.balls[i].radius + two.around.radius);
            if all_at_least(d, limit) {
                continue;
            }
            for (k, _) in two.balls.clone().zip(&open).filter(|(_, open)| **open) {
                let (mine, theirs) = (&self.balls[i], &self.balls[k]);
                let d = apart(&batch.centers[i], &batch.centers[k], 0.0);
                least = least.fast_min(d - f32x8::splat(mine.radius + theirs.radius));
                inner = inner.fast_min(d - f32x8::splat(mine.inner + theirs.inner));
            }
        }
        batch.open = open;
        let bound = least.fast_max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        let [gap, most] = [bound, inner].map(|b| (b - f32x8::splat(need)).to_array());
        visit(&Suspect { group: a, other: Other::Pair(pair), gap, most })
    }

    /// Largest distances (m) of each group's points from the axes of the joints that carry it, lane by lane: `visit`
    /// gets group, joint and distances.
    pub fn levers(
        &self,
        batch: &Batch,
        carriers: &[Vec<(usize, usize)>],
        robot: &Robot,
        mut visit: impl FnMut(usize, usize, [f32; LANES]),
    ) {
        for (group, carried) in carriers.iter().enumerate() {
            let cluster = &self.groups[group];
            if cluster.balls.is_empty() {
                continue;
            }
            for (joint, link) in carried {
                if !self.revolute[*joint] {
                    visit(group, *joint, [1.0; LANES]);
                    continue;
                }
                let frame = &batch.frames[*link];
                let axis = robot.joints()[*joint].axis();
                let axis = frame.direction(&[axis.x as f32, axis.y as f32, axis.z as f32]);
                let c = &batch.around[group];
                let arm = [c[0] - frame.t[0], c[1] - frame.t[1], c[2] - frame.t[2]];
                let across = [
                    arm[1] * axis[2] - arm[2] * axis[1],
                    arm[2] * axis[0] - arm[0] * axis[2],
                    arm[0] * axis[1] - arm[1] * axis[0],
                ];
                visit(group, *joint, (length(&across) + f32x8::splat(cluster.around.radius)).to_array());
            }
        }
    }
}

/// Whether every lane is at least `limit`; one that is no number is not.
#[inline(always)]
pub(super) fn all_at_least(value: f32x8, limit: f32x8) -> bool {
    use wide::CmpGe;
    value.cmp_ge(limit).all()
}

/// Box around what a ball covers in all lanes.
fn region(center: &Points, radius: f32) -> Aabb {
    let low = |k: usize| f64::from(center[k].to_array().into_iter().fold(f32::MAX, f32::min) - radius);
    let high = |k: usize| f64::from(center[k].to_array().into_iter().fold(f32::MIN, f32::max) + radius);
    Aabb { min: Point3::new(low(0), low(1), low(2)), max: Point3::new(high(0), high(1), high(2)) }
}
