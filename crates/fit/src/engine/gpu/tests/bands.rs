//! Pictures in bands of rows against whole ones.

use super::*;
use crate::engine::Normalised;
use crate::engine::reference::{Rasterized, Reference};
use crate::scene_render::tests::spheres;
use photofit_gpu::{Caps, Choice};

/// A fit whose pictures are drawn in so many bands, twice as many for each doubling.
fn in_bands(gpu: &Gpu, s: &Surface, shots: &[Shot], doublings: usize) -> GpuSurface {
    let mut model = GpuSurface::new(gpu, s.clone(), shots).unwrap();
    for _ in 0..doublings {
        model.bands = model.bands.finer(model.room).unwrap();
    }
    model
}

/// Differences of the loss and of both gradients.
fn differences(a: &Gradients, b: &Gradients) -> [f64; 3] {
    [(a.0 / b.0 - 1.0).abs(), difference(&a.1, &b.1), difference(&a.2, &b.2)]
}

fn assert_agree(what: impl std::fmt::Display, d: [f64; 3]) {
    assert_twin("LOSS", &what, d[0], LOSS);
    assert_twin("GRADIENT_IN_BANDS", &what, d[1].max(d[2]), GRADIENT_IN_BANDS);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn gradients_of_pictures_in_bands_agree() {
    let gpu = test_device();
    let cases = PictureLoss::ALL.into_iter().map(|loss| (false, Sampling::SUPERSAMPLED, loss));
    let robust = PictureLoss::from(Loss::LogSrgbL1);
    let layers = [(true, Sampling::SUPERSAMPLED, robust), (false, Sampling::ENGINE, robust)];
    for (sheets, sampling, loss) in cases.chain(layers) {
        let (s, shots) = (surface(sheets), shots(sampling, 56));
        let mut model = in_bands(gpu, &s, &shots, 2);
        let b = gradients(&mut model, &shots, loss);
        assert_eq!(model.stage.as_ref().map(|s| s.bands), Some(model.bands), "four bands");
        let name = loss.name();
        let [cpu, whole] =
            [on_cpu(&s, &shots, loss), on_device(gpu, &s, &shots, loss)].map(|a| differences(&a, &b));
        for (of, d) in [("CPU", cpu), ("whole pictures", whole)] {
            let what = format!("bands and {of}, sheets {sheets}, {sampling:?}, {name}");
            assert_agree(what, d);
        }
        assert!(gradients(&mut in_bands(gpu, &s, &shots, 2), &shots, loss) == b, "the same bits again");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_in_bands_are_whole() {
    let gpu = test_device();
    let (s, shots) = (surface(true), shots(Sampling::SUPERSAMPLED, 60));
    let pictures = |doublings| in_bands(gpu, &s, &shots, doublings).pictures(&shots).unwrap();
    let (whole, parts) = (pictures(0), pictures(2));
    for (a, b) in whole.iter().zip(&parts) {
        assert_eq!(a.len(), b.len());
        let off = |(a, b): &(&[f32; 4], &[f32; 4])| (0..4).any(|k| (a[k] - b[k]).abs() > PIXELS);
        let count = a.iter().zip(b).filter(off).count();
        println!("{count} of {} pixels differ", a.len());
        assert!(count * 500 < a.len(), "{count} pixels differ");
    }
    assert!(whole[0] != whole[1], "other pictures differ");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_device_without_room_for_a_picture_draws_bands() {
    let choice = Choice::Named(test_device().report().name.clone());
    let (s, shots) = (surface(false), shots(Sampling::SUPERSAMPLED, 256));
    let loss = PictureLoss::from(Loss::LogSrgbL1);
    let within = |caps: Caps| {
        let gpu = Gpu::within(&choice, caps).unwrap();
        let shown = Shown { pictures: 2, batch: 2, size: [256, 256] };
        let model = GpuSurface::new(&gpu, s.clone(), &shots).unwrap();
        let (mut model, _) = model.keeping(shown).unwrap();
        let g = gradients(&mut model, &shots, loss);
        (g, model.bands().get(), gpu.held())
    };
    let (whole, bands, taken) = within(Caps::NONE);
    assert_eq!(bands, 1);
    // A binding holds the maps, but not 16 bytes for each of four samples in a pixel.
    let binding = 16 * 4 * 256 * 256 - 4;
    let (parts, bands, _) = within(Caps { binding, ..Caps::NONE });
    assert_eq!(bands, 2, "buffers that are too large");
    let forced = gradients(&mut in_bands(test_device(), &s, &shots, 1), &shots, loss);
    assert!(parts == forced, "the same bits in as many bands");
    assert_agree("two bands", differences(&whole, &parts));
    // A little less memory than it takes, and a lot.
    let mut before = 1;
    for less in [taken / 16, taken / 2] {
        let (parts, bands, now) = within(Caps { memory: taken - less, ..Caps::NONE });
        println!("{taken} bytes as a whole, {now} in {bands} bands");
        assert!(bands > before && now <= taken - less, "{bands} bands, {now}");
        assert_agree(format!("{bands} bands"), differences(&whole, &parts));
        before = bands;
    }
    let gpu = Gpu::within(&choice, Caps { memory: taken / 8, ..Caps::NONE }).unwrap();
    let told = GpuSurface::new(&gpu, s.clone(), &shots).unwrap_err().to_string();
    assert!(told.contains("out of device memory"), "{told}");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_reference_makes_room_before_pictures_are_drawn_in_bands() {
    let choice = Choice::Named(test_device().report().name.clone());
    let (s, shots) = (surface(false), shots(Sampling::SUPERSAMPLED, 128));
    let n = Normalised::new(&spheres()).unwrap();
    let on_cpu = Rasterized::new(&n.flat, &n.library).sampled(2);
    let setup = Orbit::new(0, &Lighting::Mixed, 256).setup(Set::Train, 2, 0);
    let within = |memory: u64| Gpu::within(&choice, Caps { memory, ..Caps::NONE }).unwrap();
    let alone = within(u64::MAX);
    let whole = GpuSurface::new(&alone, s.clone(), &shots).unwrap();
    let needed = alone.held();
    drop(whole);
    // Room for the fit alone, and less of it than the buffers of the reference take.
    let gpu = within(needed + (4 << 20));
    let drawn = DrawnThere::new(&gpu, on_cpu, true);
    drawn.picture(&setup).unwrap();
    assert!(gpu.held() > 4 << 20, "{} bytes of the reference", gpu.held());
    let bands = |device_memory| {
        GpuSurface::beside(&gpu, s.clone(), &shots, device_memory).map_or(0, |model| model.bands().get())
    };
    assert_ne!(bands(None), 1);
    assert_eq!(bands(drawn.device_memory()), 1);
}
