//! Mutants of a small text against a reader: how many are read, and which rules the others break.
//!
//! `cargo run -p photofit-mutants --example reader`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_mutants::{Shape, Target};

fn main() {
    let seeds = [b"size 3 4\ncolor 10 20 30\n".to_vec()];
    let target = Target { name: "example", shape: Shape::Text, seeds: &seeds };
    let seen = target.run(|n| n == 1000, read);
    println!("{} of {} mutants are read; rules that the others break:", seen.read, seen.count);
    for rule in &seen.rules {
        println!("  {rule}");
    }
}

/// `size W H` and `color R G B`, each number a byte.
fn read(bytes: &[u8]) -> Result<(), String> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("the text must be UTF-8: {e}"))?;
    for line in text.lines() {
        let mut words = line.split(' ');
        let count = match words.next() {
            Some("size") => 2,
            Some("color") => 3,
            _ => return Err("a line must begin with size or color".into()),
        };
        let numbers = words.map(str::parse::<u8>).collect::<Result<Vec<_>, _>>();
        let numbers = numbers.map_err(|e| format!("a number must be from zero to a byte's largest: {e}"))?;
        if numbers.len() != count {
            return Err("a line must have all of its numbers and no more".into());
        }
    }
    Ok(())
}
