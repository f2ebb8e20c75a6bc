//! A path divided into cells, with the speed limits in each cell.
//!
//! On a path q(s), velocity is q' ds/dt and acceleration is q' u + q'' x, with x = (ds/dt)^2 and u = d²s/dt². Within a
//! cell, u is constant, so x changes by 2 u Δs. All limits are then linear in x and u.

use super::limits::Limits;
use super::spline::Spline;
use super::torque::{Buffers, Load, Torque};
use crate::model::Row;

/// Number of cells for a path with few waypoints; a path with more waypoints gets more cells.
const CELLS: f64 = 96.0;

/// A position on the path.
#[derive(Debug, Clone)]
pub(crate) struct Station {
    pub s: f64,
    pub position: Row,
    pub first: Row,
    pub second: Row,
}

/// A path divided into cells; the ends of the cells are called stations.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    pub joints: usize,
    pub stations: Vec<Station>,
    /// Maximum ds/dt in each cell that the caller requires, in addition to the joint limits.
    pace: Vec<f64>,
    /// Fractions of the joints' velocity and acceleration limits that may be used in each cell.
    pub shares: Vec<[f64; 2]>,
    /// Index of the station at each knot of the spline.
    pub station_of: Vec<usize>,
    /// Torques at the stations, the torque limits, and the usable fraction of the torque that gravity leaves.
    load: Option<(Vec<Torque>, Row, f64)>,
}

impl Grid {
    /// Divides a path into cells; `slowest` is the minimum time (s) of each interval between waypoints.
    pub fn new(joints: usize, path: &Spline, slowest: &[f64]) -> Self {
        let intervals = path.intervals();
        let total = path.length();
        let paces = path.paces(slowest);
        let mut out = Self {
            joints,
            stations: Vec::new(),
            pace: Vec::new(),
            shares: Vec::new(),
            station_of: Vec::new(),
            load: None,
        };
        for i in 0..intervals {
            let (from, to) = (path.knots[i], path.knots[i + 1]);
            let parts = ((to - from) / total * CELLS).ceil().max(2.0) as usize;
            let mut fractions: Vec<f64> = (0..parts).map(|k| k as f64 / parts as f64).collect();
            // Cells are short near the ends, where the motion is slow and spends most of its time.
            let cell = 1.0 / parts as f64;
            if i == 0 {
                fractions.extend([cell / 16.0, cell / 4.0]);
            }
            if i + 1 == intervals {
                fractions.extend([1.0 - cell / 4.0, 1.0 - cell / 16.0]);
            }
            fractions.sort_by(f64::total_cmp);
            out.station_of.push(out.stations.len());
            for f in fractions {
                out.stations.push(station(path, i, from + f * (to - from)));
                out.pace.push(paces[i]);
            }
        }
        out.station_of.push(out.stations.len());
        out.stations.push(station(path, intervals.saturating_sub(1), total));
        out.shares = vec![[1.0; 2]; out.pace.len()];
        out
    }

    /// Adds torque limits. Returns `None` if gravity alone exceeds them at a station.
    pub fn loaded(mut self, load: Load<'_>) -> Option<Self> {
        let Some((dynamics, room)) = load else { return Some(self) };
        let mut buffers = Buffers::default();
        let at = |s: &Station| dynamics.along(&s.position, &s.first, &s.second, &mut buffers);
        let torques: Vec<Torque> = self.stations.iter().map(at).collect();
        if !torques.iter().all(|t| dynamics.holds(t)) {
            return None;
        }
        self.load = Some((torques, dynamics.max_torque, room));
        Some(self)
    }

    pub fn cells(&self) -> usize {
        self.pace.len()
    }

    /// Returns the length of a cell.
    pub fn step(&self, cell: usize) -> f64 {
        self.stations[cell + 1].s - self.stations[cell].s
    }

    /// Returns the maximum x at each station by velocity limits and required pace, for a motion that begins with x =
    /// `begin`. A start faster than the pace is accepted; the motion then brakes as hard as the limits allow.
    pub fn ceilings(&self, limits: &Limits, begin: f64) -> Vec<f64> {
        let mut out = vec![f64::INFINITY; self.stations.len()];
        let mut pace = out.clone();
        for cell in 0..self.cells() {
            for k in [cell, cell + 1] {
                let mut speed = f64::INFINITY;
                for v in 0..self.joints {
                    speed = speed.min(self.shares[cell][0] * limits.velocity[v] / self.stations[k].first[v].abs());
                }
                if let Some(envelope) = &limits.envelope {
                    let station = &self.stations[k];
                    speed = speed.min(self.shares[cell][0] * envelope.speed(&station.position, &station.first));
                }
                out[k] = out[k].min(speed * speed);
                pace[k] = pace[k].min(self.pace[cell] * self.pace[cell]);
            }
        }
        let mut rows = Vec::new();
        let mut least = begin;
        for cell in 0..self.cells() {
            if least <= pace[cell] {
                break;
            }
            pace[cell] = least;
            self.rows(limits, cell, &mut rows);
            let slowing = rows.iter().map(|[a, b, low, high]| match *a {
                0.0 => f64::NEG_INFINITY,
                a => -b / a * least + if a > 0.0 { low / a } else { high / a },
            });
            least = (least + 2.0 * self.step(cell) * slowing.fold(f64::NEG_INFINITY, f64::max)).max(0.0);
        }
        out.iter_mut().zip(pace).for_each(|(x, slow)| *x = x.min(slow));
        // The start speed is fixed; reducing the fraction of its cell only bounds the following stations.
        out[0] = out[0].max(begin);
        out
    }

    /// Writes rows (a, b, low, high) of a cell, with the meaning low <= a u + b x <= high and x at the start of the
    /// cell. The rows bound accelerations and torques at both ends of the cell.
    pub fn rows(&self, limits: &Limits, cell: usize, out: &mut Vec<[f64; 4]>) {
        out.clear();
        let (from, to) = (&self.stations[cell], &self.stations[cell + 1]);
        let twice = 2.0 * self.step(cell);
        for v in 0..self.joints {
            let most = self.shares[cell][1] * limits.acceleration[v];
            out.push([from.first[v], from.second[v], -most, most]);
            out.push([to.first[v] + twice * to.second[v], to.second[v], -most, most]);
        }
        let Some((torques, most, room)) = &self.load else { return };
        let (from, to) = (&torques[cell], &torques[cell + 1]);
        for v in 0..self.joints {
            let [low, high] = from.band(v, most[v], *room);
            out.push([from.of_u[v], from.of_x[v], low, high]);
            let [low, high] = to.band(v, most[v], *room);
            out.push([to.of_u[v] + twice * to.of_x[v], to.of_x[v], low, high]);
        }
    }
}

fn station(path: &Spline, interval: usize, s: f64) -> Station {
    let [position, first, second] = path.derivatives(interval, s);
    Station { s, position, first, second }
}
