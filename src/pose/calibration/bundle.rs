//! The bundle adjustment: every scan's own unknowns eliminated, the parameters solved, and again.
//!
//! An interval is a box, not a measurement of its middle. Expectation propagation keeps for each the
//! Gaussian that does the same to the state, given all the other scans (their sum less this scan's
//! own part); a scan's boxes are treated together. Measured edges are Gaussian already.

use super::super::interval::{Site, truncated};
use super::super::joint;
use super::equations::{Form, OWN, Own, System, linearise};
use super::parameters::{Layout, geometry};
use super::{Observation, Options};
use crate::frame::Frame;
use nalgebra::{DMatrix, DVector};

/// Relinearisations, and passes over the scans in each.
const ROUNDS: usize = 3;
const PASSES: usize = 4;
/// Sweeps over a scan's boxes.
const SWEEPS: usize = 8;
const DAMPING: f64 = 0.8;
/// An edge that misses its bounds by more than this, m, and so many standard deviations, is not
/// used: it contradicts the others.
const VIOLATION_M: f64 = 0.0015;
const VIOLATION_SIGMAS: f64 = 3.0;

/// One scan of the bundle.
struct Member<'a> {
    observation: &'a Observation,
    own: Own,
    /// The factor along each form; nothing where the edge is refused.
    sites: Vec<Site>,
    /// What the scan says of the parameters.
    information: DMatrix<f64>,
    vector: DVector<f64>,
    refused: usize,
}

/// The parameters' posterior.
pub(super) struct Solution {
    pub(super) mean: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
    pub(super) scans: usize,
    pub(super) edges: usize,
    pub(super) measured: usize,
    pub(super) refused: usize,
}

/// Adjusts all; none where the equations have no solution.
pub(super) fn adjust(
    observations: &[Observation],
    frame: &Frame,
    prior_sigmas: &DVector<f64>,
    options: &Options,
) -> Option<Solution> {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    let n = layout.count();
    let prior = DMatrix::from_diagonal(&prior_sigmas.map(|s| 1.0 / (s * s)));
    let mut by = DVector::zeros(n);
    let mut covariance = prior.clone();
    let mut members: Vec<Member> = observations
        .iter()
        .map(|observation| Member {
            observation,
            own: {
                let mut own = observation.start;
                own[joint::THRESHOLD] = options.threshold;
                own[joint::FOOTPRINT] = options.footprint_scale;
                own
            },
            sites: Vec::new(),
            information: DMatrix::zeros(n, n),
            vector: DVector::zeros(n),
            refused: 0,
        })
        .collect();
    let (mut edges, mut measured) = (0, 0);
    for _ in 0..ROUNDS {
        let there = geometry(frame, &by);
        let mut total = prior.clone();
        let mut vector = -(&prior * &by);
        // First pass: every box as its middle.
        for member in &mut members {
            let Some(system) = linearise(member.observation, &there, &by, &member.own, options)
            else {
                member.sites.clear();
                continue;
            };
            member.sites = system.forms.iter().map(middle).collect();
            member.reduce(&system, n);
            total += &member.information;
            vector += &member.vector;
        }
        for _ in 0..PASSES {
            for member in &mut members {
                let Some(system) = linearise(member.observation, &there, &by, &member.own, options)
                else {
                    continue;
                };
                total -= &member.information;
                vector -= &member.vector;
                member.refine(&system, &total, &vector);
                member.reduce(&system, n);
                total += &member.information;
                vector += &member.vector;
            }
        }
        covariance = total.cholesky()?.inverse();
        let step = &covariance * &vector;
        (edges, measured) = (0, 0);
        for member in &mut members {
            if let Some(system) = linearise(member.observation, &there, &by, &member.own, options) {
                member.follow(&system, &step);
                edges += system.forms.len();
                measured += system.forms.iter().filter(|f| f.measured).count();
            }
        }
        by += step;
    }
    Some(Solution {
        mean: by,
        covariance,
        scans: members.iter().filter(|m| !m.sites.is_empty()).count(),
        edges,
        measured,
        refused: members.iter().map(|m| m.refused).sum(),
    })
}

/// A form as a measurement of its middle.
fn middle(form: &Form) -> Site {
    let tau = 1.0 / form.variance();
    Site {
        tau,
        nu: tau * 0.5 * (form.low + form.high),
    }
}

impl Member<'_> {
    /// Information of the scan with its sites.
    fn with_sites(&self, system: &System) -> (DMatrix<f64>, DVector<f64>) {
        let mut information = system.information.clone();
        let mut vector = system.vector.clone();
        for (form, site) in system.forms.iter().zip(&self.sites) {
            information.ger(site.tau, &form.row, &form.row, 1.0);
            vector.axpy(site.nu, &form.row, 1.0);
        }
        (information, vector)
    }

    /// Eliminates the own unknowns (Schur complement).
    fn reduce(&mut self, system: &System, n: usize) {
        let (information, vector) = self.with_sites(system);
        let own = information.view((0, 0), (OWN, OWN)).into_owned();
        let cross = information.view((0, OWN), (OWN, n)).into_owned();
        let shared = information.view((OWN, OWN), (n, n));
        match own.cholesky() {
            Some(own) => {
                let solved = own.solve(&cross);
                self.information = shared - cross.transpose() * &solved;
                self.vector =
                    vector.rows(OWN, n) - solved.transpose() * vector.rows(0, OWN).into_owned();
            }
            None => {
                self.information.fill(0.0);
                self.vector.fill(0.0);
            }
        }
    }

    /// Makes the sites what the boxes do, given what all other scans say of the parameters.
    fn refine(&mut self, system: &System, others: &DMatrix<f64>, others_vector: &DVector<f64>) {
        let n = others.nrows();
        let mut information = system.information.clone();
        let mut vector = system.vector.clone();
        let mut shared = information.view_mut((OWN, OWN), (n, n));
        shared += others;
        let mut shared = vector.rows_mut(OWN, n);
        shared += others_vector;
        let Some(factor) = information.cholesky() else {
            return;
        };
        // Only the forms matter: their joint distribution without any of their own sites.
        let m = system.forms.len();
        let mut rows = DMatrix::zeros(OWN + n, m);
        for (k, form) in system.forms.iter().enumerate() {
            rows.set_column(k, &form.row);
        }
        let spread = factor.solve(&rows);
        let covariance = rows.transpose() * &spread;
        let mean = spread.transpose() * vector;
        let mut kept = vec![true; m];
        while let Some(worst) = worst_violation(&mean, &covariance, &system.forms, &kept) {
            kept[worst] = false;
        }
        self.refused = kept.iter().filter(|k| !**k).count();
        self.sites = propagate(&mean, &covariance, &system.forms, &kept);
    }

    /// The own unknowns that go with a step of the parameters.
    fn follow(&mut self, system: &System, step: &DVector<f64>) {
        let (information, vector) = self.with_sites(system);
        let n = step.len();
        let own = information.view((0, 0), (OWN, OWN)).into_owned();
        let rest = vector.rows(0, OWN) - information.view((0, OWN), (OWN, n)) * step;
        if let Some(moved) = own.cholesky().map(|c| c.solve(&rest)) {
            for (value, by) in self.own.iter_mut().zip(moved.iter()) {
                *value += by;
            }
        }
    }
}

/// One Gaussian factor along form `k` put into the distribution of all forms.
fn update(mean: &mut DVector<f64>, covariance: &mut DMatrix<f64>, k: usize, by: Site) {
    let gain = covariance.column(k).into_owned();
    let scale = 1.0 / (1.0 + by.tau * gain[k]);
    let shift = (by.nu - by.tau * mean[k]) * scale;
    mean.axpy(shift, &gain, 1.0);
    covariance.ger(-by.tau * scale, &gain, &gain, 1.0);
}

/// The edge that contradicts the others most, if one does beyond doubt: each is compared with what
/// the other ones, as measurements of their middles, say of it.
fn worst_violation(
    mean: &DVector<f64>,
    covariance: &DMatrix<f64>,
    forms: &[Form],
    kept: &[bool],
) -> Option<usize> {
    let (mut mean, mut covariance) = (mean.clone(), covariance.clone());
    let there = || (0..forms.len()).filter(|k| kept[*k]);
    for k in there() {
        update(&mut mean, &mut covariance, k, middle(&forms[k]));
    }
    let mut worst = None;
    let mut most = 0.0;
    for k in there() {
        let form = &forms[k];
        let Site { tau, nu } = middle(form);
        // Its own part is taken out again.
        let free = 1.0 - tau * covariance[(k, k)];
        let variance = covariance[(k, k)] / free;
        let at = (mean[k] - covariance[(k, k)] * nu) / free;
        if !(free > 1e-9) {
            continue;
        }
        let miss = (form.low - at).max(at - form.high);
        let sigma = (variance + form.softness * form.softness).sqrt();
        let excess = (miss - VIOLATION_M) / sigma - VIOLATION_SIGMAS;
        if excess > most {
            (worst, most) = (Some(k), excess);
        }
    }
    worst
}

/// The sites of the boxes under a Gaussian distribution of the forms (see [`super::super::interval`]).
fn propagate(
    mean: &DVector<f64>,
    covariance: &DMatrix<f64>,
    forms: &[Form],
    kept: &[bool],
) -> Vec<Site> {
    let (mut mean, mut covariance) = (mean.clone(), covariance.clone());
    let mut sites = vec![Site::default(); forms.len()];
    for k in (0..forms.len()).filter(|k| kept[*k] && forms[*k].measured) {
        sites[k] = middle(&forms[k]);
        update(&mut mean, &mut covariance, k, sites[k]);
    }
    for _ in 0..SWEEPS {
        for k in (0..forms.len()).filter(|k| kept[*k] && !forms[*k].measured) {
            let form = &forms[k];
            let bounded =
                |mean, variance| truncated(mean, variance, [form.low, form.high], form.softness);
            let site = sites[k];
            let Some(wanted) = site.wanted(mean[k], covariance[(k, k)], bounded) else {
                continue;
            };
            let by = Site {
                tau: DAMPING * (wanted.tau - site.tau),
                nu: DAMPING * (wanted.nu - site.nu),
            };
            sites[k] = Site {
                tau: site.tau + by.tau,
                nu: site.nu + by.nu,
            };
            update(&mut mean, &mut covariance, k, by);
        }
    }
    sites
}
