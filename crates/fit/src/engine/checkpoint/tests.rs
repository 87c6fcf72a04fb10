//! What is written is read, and nothing else.

use super::*;
use photofit_mutants::{Packing, Shape, Target};

fn group(name: &'static str, rows: usize, columns: usize) -> Group {
    Group { name: name.into(), rows, columns, ranges: Vec::new(), unit: None, rates: Vec::new() }
}

fn fingerprint(asset: &str) -> Fingerprint {
    Fingerprint::default().option("batch", 2).digest("asset", asset)
}

fn rule(refusal: Refusal) -> String {
    match refusal {
        Refusal::ModelError(rule) => rule,
        Refusal::Other(differences) => panic!("{differences:?}"),
    }
}

fn sample() -> (Course, Vec<Group>, Vec<Loaded>) {
    let course = Course {
        step: 31,
        skipped: 3,
        begun: 2,
        best_quality: 23.5,
        history: vec![HistoryPoint { step: 25, seconds: 1.5, loss: 0.25, quality: 23.5 }],
        loss: vec![0.5, 0.25],
    };
    let groups = vec![group("positions", 5, 3), group("maps", 4, 2)];
    let loaded = groups
        .iter()
        .map(|g| {
            let n = g.rows * g.columns;
            let numbers = |a: f32| (0..n).map(|i| a + i as f32).collect::<Vec<f32>>();
            let optimizer = State {
                m: numbers(0.1),
                v: numbers(0.2),
                step: 31,
                scale_exponent: -7,
                mean_square: 0.125,
                row_steps: vec![3; g.rows],
            };
            Loaded { values: numbers(1.0), best: numbers(2.0), optimizer }
        })
        .collect();
    (course, groups, loaded)
}

fn bytes() -> Vec<u8> {
    let (course, groups, loaded) = sample();
    let saved: Vec<Saved<'_>> = groups
        .iter()
        .zip(&loaded)
        .map(|(group, l)| Saved { group, values: &l.values, best: &l.best, optimizer: &l.optimizer })
        .collect();
    encode(&course, &saved, &fingerprint("a")).unwrap()
}

#[test]
fn what_is_written_is_read() {
    let (course, groups, loaded) = sample();
    assert_eq!(decode(&bytes(), &groups, &fingerprint("a")).unwrap(), (course, loaded));
}

#[test]
fn damage_is_always_noticed() {
    let (_, groups, _) = sample();
    let good = bytes();
    for at in 0..good.len() {
        for bit in [0x01, 0x80] {
            let mut bad = good.clone();
            bad[at] ^= bit;
            assert!(decode(&bad, &groups, &fingerprint("a")).is_err(), "byte {at} of {}", good.len());
        }
    }
    for length in 0..good.len() {
        assert!(decode(&good[..length], &groups, &fingerprint("a")).is_err(), "cut to {length} bytes");
    }
    let longer = [&good[..], &[0; 4]].concat();
    let rule = rule(decode(&longer, &groups, &fingerprint("a")).unwrap_err());
    assert!(rule.contains("damaged"), "{rule}");
}

#[test]
fn another_fit_is_told_apart() {
    let (_, groups, _) = sample();
    let foreign = [
        vec![group("positions", 5, 3), group("texels", 4, 2)],
        vec![group("positions", 5, 3), group("maps", 5, 2)],
        vec![group("positions", 5, 3)],
    ];
    for groups in foreign {
        let rule = rule(decode(&bytes(), &groups, &fingerprint("a")).unwrap_err());
        assert!(rule.contains("another fit"), "{rule}");
    }
    let Err(Refusal::Other(d)) = decode(&bytes(), &groups, &fingerprint("b")) else { panic!("taken") };
    assert_eq!((d.len(), d[0].to_string().as_str()), (1, "asset is not the same"));
}

#[test]
fn a_huge_header_length_takes_no_memory() {
    let (_, groups, _) = sample();
    let mut bad = bytes();
    bad[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    let mut digest = Digest::new();
    digest.add_bytes(&bad[16..]);
    bad[8..16].copy_from_slice(&digest.value().to_le_bytes());
    assert!(rule(decode(&bad, &groups, &fingerprint("a")).unwrap_err()).contains("too early"));
}

#[test]
fn other_options_are_told_before_a_fit_and_what_is_no_checkpoint_is_left_to_it() {
    let dir = tempfile::tempdir().unwrap();
    let check = |batch: u32| check_options(dir.path(), &Fingerprint::default().option("batch", batch));
    check(3).unwrap();
    std::fs::write(dir.path().join(FILE), bytes()).unwrap();
    check(2).unwrap();
    let told = check(3).unwrap_err().to_string();
    assert!(told.contains("batch was 2 and is 3"), "{told}");
    let mut bytes = bytes();
    bytes[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(dir.path().join(FILE), bytes).unwrap();
    check(3).unwrap();
}

/// A checkpoint whose checksum and lengths are right, whatever its header and its numbers are.
static PACKING: Packing = Packing {
    unpack: |bytes| {
        let length = usize::try_from(u64::from_le_bytes(*bytes.get(16..)?.first_chunk()?)).ok()?;
        let (header, numbers) = bytes.get(24..)?.split_at_checked(length)?;
        Some(vec![header.to_vec(), numbers.to_vec()])
    },
    pack: |parts| {
        let mut out =
            [MAGIC, &[0; 8][..], &(parts[0].len() as u64).to_le_bytes(), &parts[0], &parts[1]].concat();
        let mut digest = Digest::new();
        digest.add_bytes(&out[16..]);
        out[8..16].copy_from_slice(&digest.value().to_le_bytes());
        out
    },
    shapes: &[Shape::Json, Shape::Bytes],
};

#[test]
fn mutants_are_read_or_refused() {
    let (_, groups, _) = sample();
    let seeds = [bytes()];
    let seen = Target { name: "checkpoint", shape: Shape::Packed(&PACKING), seeds: &seeds }.run(
        |n| n == 2000,
        |bytes| match decode(bytes, &groups, &fingerprint("a")) {
            Ok((_, loaded)) => {
                let sized = |(l, g): (&Loaded, &Group)| l.values.len() == g.rows * g.columns;
                assert!(loaded.iter().zip(&groups).all(sized), "values have the size of their group");
                Ok(())
            }
            Err(Refusal::ModelError(rule)) => Err(rule),
            Err(Refusal::Other(_)) => Err("it belongs to another fit".into()),
        },
    );
    seen.assert_deep("checkpoint", 40);
}
