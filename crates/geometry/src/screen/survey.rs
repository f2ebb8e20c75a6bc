//! Lower bounds of the distances of all checked pairs in eight configurations.

use crate::lanes::{F32x8, Wide, wide};
use nalgebra::Point3;

use super::between::{Still, Swept};
use super::points::PointGrid;
use super::solid::{Points, length};
use super::{Batch, CULL, LANES, Needs, Other, Screen, Sphere, Suspect, TREE};
use crate::{Aabb, Robot};

/// If a sphere may be closer than this (m) to a point cloud, its points are tested one by one.
const CLOSE: f32 = 0.02;

impl Screen {
    /// Computes the positions of all spheres for the configurations set in a batch.
    pub fn place(&self, batch: &mut Batch) {
        self.posing.place(&batch.q, &mut batch.frames);
        struct Work<'a>(&'a Screen, &'a mut Batch);
        impl Wide for Work<'_> {
            type Output = ();
            #[inline(always)]
            fn run(self) {
                self.0.place_around(self.1);
            }
        }
        wide(Work(self, batch));
    }

    #[inline(always)]
    pub(super) fn place_around(&self, batch: &mut Batch) {
        // No closure is used here: closures may not be inlined, and then are not compiled for wide vectors.
        batch.around.resize(self.groups.len(), [F32x8::ZERO; 3]);
        for (around, group) in batch.around.iter_mut().zip(&self.groups) {
            *around = batch.frames[group.link].point(&group.around.center);
        }
        batch.examined.resize(self.groups.len() * (self.solids.len() + self.clouds.len()) + self.pairs.len(), 0);
        batch.placements = batch.placements.wrapping_add(1);
        batch.centers.resize(self.balls.len(), [F32x8::ZERO; 3]);
        // A NaN must not count as within the travel.
        batch.within_travel = true;
        for (joint, most) in &self.travels {
            batch.within_travel &= all_at_least(F32x8::splat(*most) - batch.q[*joint].abs(), F32x8::ZERO);
        }
        batch.ready.clear();
        batch.ready.resize(self.groups.len(), false);
    }

    /// Computes the spheres of a group. For motions, the batch holds their middles.
    #[inline(always)]
    fn ensure<S: Swept>(&self, group: usize, batch: &mut Batch, swept: &mut S) {
        if !batch.ready[group] {
            let cluster = &self.groups[group];
            let frame = batch.frames[cluster.link];
            for b in cluster.balls.clone() {
                batch.centers[b] = frame.point(&self.balls[b].center);
            }
            swept.swell(self, group);
            batch.ready[group] = true;
        }
    }

    /// Calls `visit` for each pair whose distance, in some lane, may be less than the required distance plus `reach`
    /// (m). `visit` returns whether to continue. Pairs that were [examined alone](Self::look_at) since the last
    /// [placement](Self::place) are left out.
    pub fn survey(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        reach: f32,
        mut visit: impl FnMut(&Suspect) -> bool,
    ) -> bool {
        self.survey_each(batch, needs, reach, &mut visit)
    }

    fn survey_each(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        struct Work<'a> {
            screen: &'a Screen,
            batch: &'a mut Batch,
            needs: &'a Needs,
            reach: f32,
            visit: &'a mut dyn FnMut(&Suspect) -> bool,
        }
        impl Wide for Work<'_> {
            type Output = bool;
            #[inline(always)]
            fn run(self) -> bool {
                let Self { screen, batch, needs, reach, visit } = self;
                screen.surveyed(batch, &mut Still, needs, reach, visit)
                    && screen.surveyed_pairs(batch, needs, reach, visit)
            }
        }
        wide(Work { screen: self, batch, needs, reach, visit })
    }

    /// Examines all groups and bodies.
    #[inline(always)]
    pub(super) fn surveyed<S: Swept>(
        &self,
        batch: &mut Batch,
        swept: &mut S,
        needs: &Needs,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        for group in (0..self.groups.len()).rev() {
            let cluster = &self.groups[group];
            if cluster.balls.is_empty() {
                continue;
            }
            let row = &needs.bodies[group * self.bodies..(group + 1) * self.bodies];
            let furthest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if furthest == f64::NEG_INFINITY {
                continue;
            }
            let mut near = std::mem::take(&mut batch.near);
            self.gather(group, batch, swept.radius(self, group), furthest + f64::from(reach), &mut near);
            let mut whole = true;
            for e in near.iter().map(|e| *e as usize) {
                if batch.examined[group * self.solids.len() + e] == batch.placements {
                    continue;
                }
                whole = self.against_solid((group, e), row[self.body_of[e]], batch, swept, reach, visit);
                if !whole {
                    break;
                }
            }
            batch.near = near;
            if !whole {
                return false;
            }
            for (c, cloud) in self.clouds.iter().enumerate() {
                if cloud.from_base > 0.0 {
                    let extent = length(&batch.around[group]) + swept.radius(self, group);
                    let limit = F32x8::splat(furthest as f32 + reach);
                    if all_at_least(F32x8::splat(cloud.from_base) - extent, limit) {
                        continue;
                    }
                }
                if batch.examined[self.place_of(group, Other::Cloud(c))] == batch.placements {
                    continue;
                }
                if !self.against_cloud((group, c), row[cloud.body], batch, swept, reach, visit) {
                    return false;
                }
            }
        }
        true
    }

    /// Writes the obstacles whose boxes come closer than `farthest` (m) to a group in some lane.
    #[inline(always)]
    fn gather(&self, group: usize, batch: &Batch, radius: F32x8, farthest: f64, near: &mut Vec<u32>) {
        near.clear();
        let center = &batch.around[group];
        // A NaN must not count as far away.
        if !all_at_least(center[0].abs() + center[1].abs() + center[2].abs() + radius, F32x8::ZERO) {
            near.extend(0..self.solids.len() as u32);
            return;
        }
        let [low, high] = region(center, radius);
        let reachable = &self.reachable[group];
        let is_near = batch.within_travel && farthest <= CULL;
        if let (true, Some(tree)) = (!is_near || reachable.indices.len() >= TREE, &self.tree) {
            let bounds = Aabb { min: Point3::from(low.map(f64::from)), max: Point3::from(high.map(f64::from)) };
            tree.near(&bounds, farthest.max(0.0), |e| near.push(e as u32));
            return;
        }
        if !is_near {
            near.extend(0..self.solids.len() as u32);
            return;
        }
        let limit = farthest as f32 + self.slack;
        for (block, indices) in reachable.boxes.iter().zip(reachable.indices.chunks(LANES)) {
            let mut apart = F32x8::splat(f32::MIN);
            for k in 0..3 {
                apart = apart.max(block[0][k] - F32x8::splat(high[k])).max(F32x8::splat(low[k]) - block[1][k]);
            }
            if !all_at_least(apart, F32x8::splat(limit)) {
                let apart = apart.to_array();
                near.extend((0..indices.len()).filter(|k| apart[*k] < limit).map(|k| indices[k]));
            }
        }
    }

    /// Examines all pairs of groups.
    #[inline(always)]
    fn surveyed_pairs(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        for pair in 0..self.pairs.len() {
            if batch.examined[self.place_of(0, Other::Pair(pair))] == batch.placements {
                continue;
            }
            if !self.against_group(pair, needs.pairs[pair], batch, reach, visit) {
                return false;
            }
        }
        true
    }

    /// Index of a pair in `Batch::examined`.
    #[inline(always)]
    fn place_of(&self, group: usize, other: Other) -> usize {
        let (groups, solids) = (self.groups.len(), self.solids.len());
        match other {
            Other::Element(e) => group * solids + e,
            Other::Cloud(c) => groups * solids + group * self.clouds.len() + c,
            Other::Pair(pair) => groups * (solids + self.clouds.len()) + pair,
        }
    }

    #[inline(always)]
    pub(super) fn against_solid<S: Swept>(
        &self,
        (group, e): (usize, usize),
        need: f64,
        batch: &mut Batch,
        swept: &mut S,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (obstacle, cluster, need) = (&self.solids[e], &self.groups[group], need as f32);
        let limit = F32x8::splat(reach + need);
        let radius = swept.radius(self, group);
        let (mut solid, mut coarse) = (&obstacle.first, obstacle.first.distance(&batch.around[group]) - radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        if let Some(hull) = obstacle.hull() {
            (solid, coarse) = (hull, hull.distance(&batch.around[group]) - radius);
            if all_at_least(coarse, limit) {
                return true;
            }
        }
        self.ensure(group, batch, swept);
        let own = cluster.balls.clone();
        let swells = swept.swells(&own);
        let [least, inner] = solid.least::<S>(&batch.centers[own.clone()], &self.balls[own], swells);
        // Both values are lower bounds, so the larger one is valid and tighter.
        let bound = least.max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        let max_gap = (inner + F32x8::splat(obstacle.looseness - need)).to_array();
        visit(&Suspect { group, other: Other::Element(e), gap: (bound - F32x8::splat(need)).to_array(), max_gap })
    }

    #[inline(always)]
    pub(super) fn against_cloud<S: Swept>(
        &self,
        (group, c): (usize, usize),
        need: f64,
        batch: &mut Batch,
        swept: &mut S,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (cloud, cluster, need) = (&self.clouds[c], &self.groups[group], need as f32);
        let limit = F32x8::splat(reach + need);
        let coarse = cloud.bounds(&batch.around[group]) - swept.radius(self, group);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(group, batch, swept);
        let own = cluster.balls.clone();
        let swells = swept.swells(&own);
        let mut bounds = std::mem::take(&mut batch.bounds);
        bounds.clear();
        let mut bound = F32x8::splat(f32::MAX);
        for (k, (center, ball)) in batch.centers[own.clone()].iter().zip(&self.balls[own.clone()]).enumerate() {
            let mut d = cloud.bounds(center) - F32x8::splat(ball.radius);
            if S::MOVES {
                d = d - swells[k];
            }
            let d = d.max(coarse);
            bound = bound.min(d);
            bounds.push(d);
        }
        let mut gap = bound.to_array();
        let mut max_gap = [f32::MAX; LANES];
        if !all_at_least(bound, limit) {
            let close = need + reach.min(CLOSE);
            for lane in 0..LANES {
                // A NaN counts as too close.
                if !is_at_least(gap[lane], close) {
                    let balls = batch.centers[own.clone()].iter().zip(&self.balls[own.clone()]);
                    [gap[lane], max_gap[lane]] = nearest(cloud, lane, close, balls, swells, &bounds);
                }
            }
        }
        batch.bounds = bounds;
        if all_at_least(F32x8::new(gap), limit) {
            return true;
        }
        let [gap, max_gap] = [gap, max_gap].map(|of| of.map(|d| d - need));
        visit(&Suspect { group, other: Other::Cloud(c), gap, max_gap })
    }

    #[inline(always)]
    fn against_group(
        &self,
        pair: usize,
        need: f64,
        batch: &mut Batch,
        reach: f32,
        visit: &mut dyn FnMut(&Suspect) -> bool,
    ) -> bool {
        if need == f64::NEG_INFINITY {
            return true;
        }
        let (a, b) = self.pairs[pair];
        let (one, two, need) = (&self.groups[a], &self.groups[b], need as f32);
        let limit = F32x8::splat(reach + need);
        let coarse = apart(&batch.around[a], &batch.around[b], one.around.radius + two.around.radius);
        if all_at_least(coarse, limit) {
            return true;
        }
        self.ensure(a, batch, &mut Still);
        self.ensure(b, batch, &mut Still);
        // Collects the spheres of the second group that are close to the first group.
        let mut open = std::mem::take(&mut batch.open);
        open.clear();
        for k in two.balls.clone() {
            let d = apart(&batch.centers[k], &batch.around[a], self.balls[k].radius + one.around.radius);
            open.push(!all_at_least(d, limit));
        }
        let mut least = F32x8::splat(reach + need);
        let mut inner = F32x8::splat(f32::MAX);
        for i in one.balls.clone() {
            let d = apart(&batch.centers[i], &batch.around[b], self.balls[i].radius + two.around.radius);
            if all_at_least(d, limit) {
                continue;
            }
            for (k, _) in two.balls.clone().zip(&open).filter(|(_, open)| **open) {
                let (mine, theirs) = (&self.balls[i], &self.balls[k]);
                let d = apart(&batch.centers[i], &batch.centers[k], 0.0);
                least = least.min(d - F32x8::splat(mine.radius + theirs.radius));
                inner = inner.min(d - F32x8::splat(mine.inner + theirs.inner));
            }
        }
        batch.open = open;
        let bound = least.max(coarse);
        if all_at_least(bound, limit) {
            return true;
        }
        let [gap, max_gap] = [bound, inner].map(|b| (b - F32x8::splat(need)).to_array());
        visit(&Suspect { group: a, other: Other::Pair(pair), gap, max_gap })
    }

    /// Examines one group and one other body up to `reach` (m), in the same way as [`Screen::survey`] examines all
    /// pairs.
    pub fn look_at(
        &self,
        batch: &mut Batch,
        needs: &Needs,
        (group, other): (usize, Other),
        reach: f32,
        mut visit: impl FnMut(&Suspect) -> bool,
    ) -> bool {
        struct Work<'a> {
            screen: &'a Screen,
            batch: &'a mut Batch,
            group: usize,
            other: Other,
            need: f64,
            reach: f32,
            visit: &'a mut dyn FnMut(&Suspect) -> bool,
        }
        impl Wide for Work<'_> {
            type Output = bool;
            #[inline(always)]
            fn run(self) -> bool {
                let Self { screen, batch, group, other, need, reach, visit } = self;
                match other {
                    Other::Element(e) => screen.against_solid((group, e), need, batch, &mut Still, reach, visit),
                    Other::Cloud(c) => screen.against_cloud((group, c), need, batch, &mut Still, reach, visit),
                    Other::Pair(pair) => screen.against_group(pair, need, batch, reach, visit),
                }
            }
        }
        let need = self.needed(needs, group, other);
        batch.examined[self.place_of(group, other)] = batch.placements;
        wide(Work { screen: self, batch, group, other, need, reach, visit: &mut visit })
    }

    /// Passes to `visit` the lever arms of one group: joint, and maximum distance (m) of the group's points from this
    /// joint's axis in every lane. `carried` are the joints that carry the group, each with the link that it moves.
    pub fn levers_of(
        &self,
        batch: &Batch,
        group: usize,
        carried: &[(usize, usize)],
        robot: &Robot,
        mut visit: impl FnMut(usize, [f32; LANES]),
    ) {
        let cluster = &self.groups[group];
        if cluster.balls.is_empty() {
            return;
        }
        for (joint, link) in carried {
            if !self.revolute[*joint] {
                visit(*joint, [1.0; LANES]);
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
            visit(*joint, (length(&across) + F32x8::splat(cluster.around.radius)).to_array());
        }
    }
}

/// Returns a lower bound of the distance (m) between spheres and a point cloud, at most `close`, and an upper bound
/// from the inner spheres. At least one sphere's bound must be below `close`.
#[inline(always)]
fn nearest<'a>(
    cloud: &PointGrid,
    lane: usize,
    close: f32,
    balls: impl Iterator<Item = (&'a Points, &'a Sphere)> + Clone,
    swells: &[F32x8],
    bounds: &[F32x8],
) -> [f32; 2] {
    let bound = |k: usize| bounds[k].to_array()[lane];
    let first = (0..bounds.len()).min_by(|a, b| bound(*a).total_cmp(&bound(*b)));
    let (mut least, mut inner) = (f32::MAX, f32::MAX);
    let others = balls.clone().enumerate().filter(|(k, _)| Some(*k) != first);
    for (k, (center, ball)) in balls.clone().enumerate().skip(first.unwrap_or(0)).take(1).chain(others) {
        let most = least.min(close);
        if is_at_least(bound(k), most) {
            least = least.min(bound(k));
            continue;
        }
        let place = [0, 1, 2].map(|e| center[e].to_array()[lane]);
        let radius = ball.radius + swells.get(k).map_or(0.0, |s| s.to_array()[lane]);
        match cloud.nearest(place, most + radius + cloud.ball()) {
            Some(d) => {
                least = least.min(d - radius - cloud.ball());
                inner = inner.min(d - ball.inner - cloud.inner_ball());
            }
            None => least = most,
        }
    }
    [least, inner]
}

/// Returns whether a number is at least another; false for NaN.
#[inline(always)]
fn is_at_least(value: f32, limit: f32) -> bool {
    value >= limit
}

/// Returns the gap between two spheres whose radii sum to `radii`.
#[inline(always)]
pub(super) fn apart(p: &Points, q: &Points, radii: f32) -> F32x8 {
    length(&[p[0] - q[0], p[1] - q[1], p[2] - q[2]]) - F32x8::splat(radii)
}

/// Returns whether every lane is at least `limit`; false for NaN.
#[inline(always)]
pub(super) fn all_at_least(value: F32x8, limit: F32x8) -> bool {
    value.all_at_least(limit)
}

/// Returns the minimum and maximum of a box around eight spheres, one in each lane.
#[inline(always)]
fn region(center: &Points, radius: F32x8) -> [[f32; 3]; 2] {
    let mut out = [[0.0; 3]; 2];
    for k in 0..3 {
        let (low, high) = ((center[k] - radius).to_array(), (center[k] + radius).to_array());
        let (mut least, mut most) = (low[0], high[0]);
        for lane in 1..LANES {
            least = if low[lane] < least { low[lane] } else { least };
            most = if high[lane] > most { high[lane] } else { most };
        }
        (out[0][k], out[1][k]) = (least, most);
    }
    out
}
