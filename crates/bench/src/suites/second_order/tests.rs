//! The gates of the specification that need the tasks, and the tasks' own sanity.

use super::race::METHODS;
use super::tasks::{Task, box2, box10, gaussian, quad};
use super::{Trace, median, rendered};

fn traces(task: &Task, method: &str, seeds: u64) -> Vec<Trace> {
    let entry = METHODS.iter().find(|m| m.name == method).expect("a method");
    (0..seeds).map(|seed| (entry.run)(task, seed).expect("a run")).collect()
}

/// Runs that got to 1% of the error, and the median of their evaluations.
fn solved(task: &Task, method: &str) -> (usize, f64) {
    let traces = traces(task, method, 20);
    let evaluations = traces.iter().map(|t| t.done().map_or(f64::INFINITY, |d| d.0 as f64));
    (traces.iter().filter(|t| t.done().is_some()).count(), median(evaluations))
}

#[test]
fn l_bfgs_solves_every_run_within_the_known_evaluations() {
    for task in [quad(), gaussian(), box2(), box10()] {
        let (runs, evaluations) = solved(&task, "sampled, L-BFGS");
        let known = task.known[1].expect("a figure") as f64;
        println!("{}: {runs}/20, {evaluations} evaluations, known {known}", task.name);
        assert!(runs == 20 && evaluations <= known, "{}: {runs}/20 in {evaluations}", task.name);
    }
}

#[test]
fn adam_keeps_to_the_known_evaluations() {
    for (task, least) in [(quad(), 20), (gaussian(), 20), (box2(), 20), (box10(), 17)] {
        let (runs, evaluations) = solved(&task, "sampled, Adam");
        let known = task.known[0].expect("a figure") as f64;
        println!("{}: {runs}/20, {evaluations} evaluations, known {known}", task.name);
        assert!(runs >= least && evaluations <= known, "{}: {runs}/20 in {evaluations}", task.name);
    }
}

#[test]
fn finite_differences_see_nothing_on_a_plateau() {
    let (runs, _) = solved(&Task { budget: 400, ..box2() }, "differences, Adam");
    assert_eq!(runs, 0);
}

#[test]
fn rendered_tasks_are_best_at_their_answers() {
    let tasks = [
        rendered::mug_task(),
        rendered::shadow_task().expect("a mesh"),
        rendered::bunny_task().expect("a mesh"),
        rendered::texture_task(),
    ];
    for task in tasks {
        assert_eq!((task.f)(&task.target, 0), 0.0, "{}", task.name);
        for seed in 0..5 {
            let start = (task.start)(seed);
            assert!((task.f)(&start, 0) > 1e-4, "{} seed {seed}", task.name);
            assert!(task.error(&start) > 0.1, "{} seed {seed}", task.name);
        }
    }
}

#[test]
fn l_bfgs_turns_the_mug() {
    let task = rendered::mug_task();
    let runs = traces(&task, "sampled, L-BFGS", 5);
    let left: Vec<f64> = runs.iter().map(Trace::best).collect();
    assert!(left.iter().all(|left| *left <= super::race::DONE), "{left:?}");
}
