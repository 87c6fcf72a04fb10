//! Round trips, bad bytes and bombs of OpenEXR.

use super::*;
use crate::{decode, read};

fn pattern(width: usize, height: usize, channels: usize) -> Image {
    Image::from_fn(width, height, channels, |x, y, c| (x as f32 - 3.5) * 1.25 + (y * 7 + c) as f32 * 1e-3)
}

fn written(layers: &[(&str, &Image, &[&str])]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write_exr(&path, layers).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn layers_round_trip_with_names_and_channel_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("aov.exr");
    let mut color = pattern(13, 9, 4);
    color.data[5] = f32::NAN;
    color.data[6] = f32::INFINITY;
    let (normal, depth) = (pattern(13, 9, 3), pattern(13, 9, 1));
    let rgba: &[&str] = &["R", "G", "B", "A"];
    write_exr(
        &path,
        &[("color", &color, rgba), ("normal", &normal, &["X", "Y", "Z"]), ("depth", &depth, &["Z"])],
    )
    .unwrap();
    let layers = read_exr_layers(&path).unwrap();
    let names: Vec<&str> = layers.iter().map(|l| l.0.as_str()).collect();
    assert_eq!(names, ["color", "normal", "depth"]);
    assert_eq!(layers[0].2, rgba);
    let bits = |i: &Image| i.data.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&layers[0].1), bits(&color));
    assert_eq!(layers[1].1, normal);
    assert_eq!((&layers[2].1, layers[2].2.as_slice()), (&depth, &["Z".to_owned()][..]));
    assert_eq!(bits(&read(&path).unwrap()), bits(&color), "the first layer");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

#[test]
fn channel_prefixes_become_layers() {
    let image = pattern(4, 3, 5);
    let bytes = written(&[("", &image, &["albedo.G", "B", "R", "albedo.R", "G"])]);
    let layers = interleaved(planes::decode_planes(&bytes, "x", &Limits::default(), every).unwrap());
    assert_eq!(layers[0].0, "");
    assert_eq!(layers[0].2, ["R", "G", "B"]);
    assert_eq!(layers[0].1, image.select(&[2, 4, 1]));
    assert_eq!(layers[1].0, "albedo");
    assert_eq!(layers[1].1, image.select(&[3, 0]));
}

#[test]
fn planes_are_read_of_wanted_layers_alone_and_written_alike() {
    let folder = tempfile::tempdir().unwrap();
    let [path, again] = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
    let image = pattern(13, 40, 5);
    write_exr(&path, &[("", &image, &["albedo.G", "B", "R", "albedo.R", "G"])]).unwrap();
    let wanted = |layers: &[ExrLayer]| {
        assert!(layers.iter().all(|l| l.planes.is_empty() && (l.width, l.height) == (13, 40)));
        layers.iter().map(|l| l.name == "albedo").collect()
    };
    let [plain, albedo] = &read_exr_planes(&path, wanted).unwrap()[..] else { panic!("two layers") };
    assert!(plain.planes.is_empty() && plain.channels == ["R", "G", "B"]);
    assert_eq!(albedo.channels, ["R", "G"]);
    assert_eq!(albedo.to_image(), image.select(&[3, 0]));
    write_exr_planes(&again, std::slice::from_ref(albedo)).unwrap();
    let layers = read_exr_layers(&again).unwrap();
    assert_eq!((&layers[0].0, &layers[0].1), (&"albedo".to_owned(), &image.select(&[3, 0])));
}

#[test]
fn halves_and_integers_become_singles() {
    let samples = [
        FlatSamples::F16((0..12).map(|i| exr::prelude::f16::from_f32(0.5 * i as f32 - 1.0)).collect()),
        FlatSamples::U32((0..12).map(|i| 100_000 * i).collect()),
    ];
    let list = samples.into_iter().zip(["H", "U"]).map(|(s, name)| AnyChannel::new(text(name).unwrap(), s));
    let layer = Layer::new((4, 3), LayerAttributes::default(), ENCODING, AnyChannels::sort(list.collect()));
    let mut bytes = Cursor::new(Vec::new());
    exr::image::Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    let image = decode(bytes.get_ref(), "x", &Limits::default()).unwrap();
    let wanted = Image::from_fn(4, 3, 2, |x, y, c| {
        let i = (4 * y + x) as f32;
        if c == 0 { 0.5 * i - 1.0 } else { 1e5 * i }
    });
    assert_eq!(image, wanted);
}

#[test]
fn wrong_layers_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let (a, b, none) = (pattern(4, 4, 1), pattern(4, 5, 1), Image::new(0, 0, 1));
    let long = "n".repeat(300);
    let cases: [&[(&str, &Image, &[&str])]; 7] = [
        &[],
        &[("none", &none, &["Y"])],
        &[("a", &a, &["Y"]), ("b", &b, &["Y"])],
        &[("a", &a, &["Y"]), ("a", &a, &["Y"])],
        &[("a", &a, &["Y"]), ("", &a, &["Y"])],
        &[("a", &a, &[""])],
        &[(&long, &a, &["Y"])],
    ];
    for (i, layers) in cases.iter().enumerate() {
        let message = write_exr(&path, layers).unwrap_err().to_string();
        assert!(message.contains("a.exr"), "case {i}: {message}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Overwrites the data window and the display window of a one-part file.
fn claim(mut bytes: Vec<u8>, width: i32, height: i32) -> Vec<u8> {
    for name in [b"dataWindow\0box2i\0", b"displayWindow\0box"] {
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
        let at = at + bytes[at..].windows(6).position(|w| w == b"box2i\0").unwrap() + 10;
        bytes[at + 8..at + 12].copy_from_slice(&(width - 1).to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&(height - 1).to_le_bytes());
    }
    bytes
}

#[test]
fn bombs_are_refused_before_memory_is_taken() {
    let image = pattern(8, 8, 3);
    let bytes = written(&[("", &image, &["R", "G", "B"])]);
    assert_eq!(decode(&claim(bytes.clone(), 8, 8), "same", &Limits::default()).unwrap(), image);
    for (w, h) in [(100_000, 100_000), (20_000, 20_000), (i32::MAX, 1), (1, i32::MAX), (4000, 4000)] {
        let message =
            decode(&claim(bytes.clone(), w, h), "bomb.exr", &Limits::default()).unwrap_err().to_string();
        assert!(message.starts_with("bomb.exr: "), "{message}");
    }
    let small = Limits { max_samples: 191, ..Limits::default() };
    assert!(matches!(decode(&bytes, "x", &small), Err(ImageError::TooLarge { .. })));
}

#[test]
fn truncated_files_are_errors() {
    let bytes = written(&[("", &pattern(16, 40, 2), &["R", "G"])]);
    for keep in (0..bytes.len()).step_by(3) {
        assert!(decode(&bytes[..keep], "x", &Limits::default()).is_err(), "{keep} of {} bytes", bytes.len());
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let image = pattern(5, 20, 2);
    let files = [
        written(&[("", &image, &["R", "G"])]),
        written(&[("a", &image, &["R", "G"]), ("b", &image, &["R", "G"])]),
    ];
    for file in files {
        for i in 0..file.len() {
            for flip in [0x01, 0x10, 0x80, 0xff] {
                let mut bad = file.clone();
                bad[i] ^= flip;
                let _ = decode(&bad, "x", &Limits::default());
            }
        }
    }
}

#[test]
fn channels_of_one_part_come_back_as_layers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("aov.exr");
    let color = Image::from_fn(5, 3, 4, |x, y, c| (x + 10 * y + 100 * c) as f32);
    let depth = Image::from_fn(5, 3, 1, |x, y, _| (x * y) as f32 + 0.5);
    let normal = Image::from_fn(5, 3, 3, |x, _, c| x as f32 - c as f32);
    let layers: [(&str, &Image, &[&str]); 3] = [
        ("", &color, &["R", "G", "B", "A"]),
        ("depth", &depth, &["Z"]),
        ("normal", &normal, &["X", "Y", "Z"]),
    ];
    write_exr_channels(&path, &layers, &[("renderer", "photofit"), ("spp", "64")]).unwrap();
    let read = read_exr_layers(&path).unwrap();
    assert_eq!(read.len(), 3);
    for ((name, image, channels), (found, pixels, names)) in layers.iter().zip(&read) {
        assert_eq!((*name, image.data.as_slice()), (found.as_str(), pixels.data.as_slice()));
        assert_eq!(names, channels);
    }
    let bytes = std::fs::read(&path).unwrap();
    let has = |text: &[u8]| bytes.windows(text.len()).any(|w| w == text);
    assert!(has(b"renderer") && has(b"photofit") && has(b"spp"), "metadata is in the file");
    let twice = [layers[0], layers[0]];
    assert!(write_exr_channels(&path, &twice, &[]).unwrap_err().to_string().contains("\"R\""));
    assert!(write_exr_channels(&path, &[], &[]).is_err());
}
