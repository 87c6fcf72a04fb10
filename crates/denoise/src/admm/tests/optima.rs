//! Energies against the stored optima of an independent solver.

use super::problems::{cases, stored};
use crate::admm::{Admm, LinearStep, Penalties};

/// Largest relative gap after so many iterations, for every model.
const TARGETS: [(usize, f64); 4] = [(50, 1e-2), (100, 3e-3), (200, 1e-3), (1000, 2e-4)];

#[test]
fn energies_reach_the_optima() {
    let all = cases().into_iter().map(|case| (case, LinearStep::Exact));
    let soft = cases().into_iter().filter(|case| case.problem().beta.is_none());
    for (case, linear) in all.chain(soft.map(|case| (case, LinearStep::Sweep))) {
        let problem = case.problem();
        // Holes are filled by neighbours only: more iterations.
        let slow = linear == LinearStep::Sweep && case.name.contains("holes");
        let [optimum, probe] = stored(case.name);
        let at_probe = problem.energy(&case.probe);
        assert!((at_probe / probe - 1.0).abs() < 1e-9, "{}: another problem: {at_probe} {probe}", case.name);
        let penalties = Penalties::for_problem(&problem);
        let mut admm = Admm::with_linear_step(&problem, penalties, None, linear).expect("a good problem");
        assert_eq!(admm.plan().sweep, linear == LinearStep::Sweep);
        let mut line = format!("{:16} {linear:?}", case.name);
        for k in 1..=1000 {
            admm.step();
            let target = TARGETS.iter().find(|(at, _)| *at == k).map(|t| t.1);
            if target.is_none() && k != 20 {
                continue;
            }
            let gap = problem.energy(&admm.solution()) / optimum - 1.0;
            line += &format!(" {gap:8.1e}");
            assert!(gap > -1e-8, "{}: better than the optimum: {line}", case.name);
            assert!(target.is_none_or(|t| gap <= if slow { 5.0 * t } else { t }), "{}: {line}", case.name);
        }
        println!("{line}");
    }
}
