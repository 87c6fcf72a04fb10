//! Golden-image tests: small pictures under `tests/golden` that the CPU path must reproduce.
//!
//! A case is a function that makes an image ([`cases::CASES`]). Its golden file is written only by
//! `cargo xtask golden accept NAME`; tests read it and never write it. A missing or wrong-sized file is an error.
//! Every comparison lands in `target/golden/report.html` with actual, expected, difference and numbers.

pub mod cases;
pub mod compare;
pub mod report;
pub mod store;
pub mod suite;
pub mod tolerances;
