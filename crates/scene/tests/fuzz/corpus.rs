//! Valid files: every part that the readers know, small.

use photofit_image::{Image, encode_png};
use photofit_mutants::glb as container;
#[cfg(feature = "mitsuba")]
use photofit_mutants::{Packing, Shape};
use photofit_scene::{Compression, Precision, Scene, TextureEncoding};
use serde_json::{Value, json};

pub(crate) const MTL: &str =
    "newmtl a\nKd .5 .4 .3\nKs .1 .1 .1\nNs 30\nPr .4\nPm .1\nd .9\nnewmtl b\nKe 1 1 1\nillum 2\n";

/// Binary data and the views into it.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Binary {
    fn view(&mut self, data: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": data.len()}));
        self.bytes.extend(data);
        self.views.len() - 1
    }

    fn floats(&mut self, data: &[f32], kind: &str, width: usize) -> usize {
        let bytes: Vec<u8> = data.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let of = |f: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
            (0..width).map(|k| data.iter().skip(k).step_by(width).fold(start, |a, b| f(a, *b))).collect()
        };
        self.accessors.push(json!({
            "bufferView": view, "componentType": 5126, "count": data.len() / width, "type": kind,
            "min": of(f32::min, f32::MAX), "max": of(f32::max, f32::MIN)
        }));
        self.accessors.len() - 1
    }

    fn words(&mut self, data: &[u16], kind: &str, width: usize) -> usize {
        let bytes: Vec<u8> = data.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        self.accessors.push(
            json!({"bufferView": view, "componentType": 5123, "count": data.len() / width, "type": kind}),
        );
        self.accessors.len() - 1
    }
}

/// A textured and skinned square with a morph target, an animation, a light, a camera and extensions.
fn document() -> (Value, Vec<u8>) {
    let mut b = Binary::default();
    let position = b.floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.], "VEC3", 3);
    let normal = b.floats(&[0., 0., 1.].repeat(4), "VEC3", 3);
    let uv = b.floats(&[0., 0., 1., 0., 1., 1., 0., 1.], "VEC2", 2);
    let weights = b.floats(&[1., 0., 0., 0.].repeat(4), "VEC4", 4);
    let joints = b.words(&[0, 1, 0, 0].repeat(4), "VEC4", 4);
    let indices = b.words(&[0, 1, 2, 0, 2, 3], "SCALAR", 1);
    let moved = b.floats(&[0., 0., 0.2].repeat(4), "VEC3", 3);
    let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    let bind = b.floats(&identity.repeat(2), "MAT4", 16);
    let times = b.floats(&[0., 1.], "SCALAR", 1);
    let turns = b.floats(&[0., 0., 0., 1., 0., 0.7, 0., 0.7], "VEC4", 4);
    let (at, values) = (b.view(&[1, 0, 2, 0]), b.view(&[0; 24]));
    b.accessors.push(json!({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 2,
        "indices": {"bufferView": at, "componentType": 5123}, "values": {"bufferView": values}}}));
    let sparse = b.accessors.len() - 1;
    let image = b.view(&png());
    let document = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat", "KHR_materials_transmission",
            "KHR_materials_volume", "KHR_texture_transform", "KHR_materials_emissive_strength"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 3, "spot": {"innerConeAngle": 0.1}}]}},
        "scene": 0, "scenes": [{"nodes": [0, 3, 4]}],
        "nodes": [
            {"mesh": 0, "skin": 0, "name": "square", "extras": {"a": 1}},
            {"children": [2], "rotation": [0, 0, 0, 1]},
            {"translation": [0, 0.1, 0]},
            {"children": [1], "matrix": identity, "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"camera": 0, "scale": [1, 2, 1]}
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": bind}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
            "samplers": [{"input": times, "output": turns}]}],
        "meshes": [{"weights": [0.5], "primitives": [{
            "attributes": {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "JOINTS_0": joints, "WEIGHTS_0": weights},
            "indices": indices, "material": 0, "mode": 4, "targets": [{"POSITION": moved}, {"POSITION": sparse}]}]}],
        "materials": [{"alphaMode": "MASK", "alphaCutoff": 0.4, "doubleSided": true, "emissiveFactor": [0.1, 0, 0],
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
                "extensions": {"KHR_texture_transform": {"offset": [0.1, 0], "scale": [2, 2]}}}, "roughnessFactor": 0.4},
            "normalTexture": {"index": 0, "scale": 0.5}, "occlusionTexture": {"index": 0, "strength": 0.5},
            "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5},
                "KHR_materials_transmission": {"transmissionFactor": 0.5},
                "KHR_materials_volume": {"attenuationDistance": 2, "attenuationColor": [0.5, 0.6, 0.7]},
                "KHR_materials_emissive_strength": {"emissiveStrength": 2}}}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071}],
        "images": [{"bufferView": image, "mimeType": "image/png"}],
        "bufferViews": b.views, "accessors": b.accessors, "buffers": [{"byteLength": b.bytes.len()}]
    });
    (document, b.bytes)
}

pub(crate) fn gltf() -> Vec<Vec<u8>> {
    let (mut document, binary) = document();
    document["buffers"][0]["uri"] =
        format!("data:application/octet-stream;base64,{}", base64(&binary)).into();
    vec![serde_json::to_vec(&document).expect("JSON is written")]
}

pub(crate) fn glb() -> Vec<Vec<u8>> {
    let (document, binary) = document();
    vec![container(&serde_json::to_vec(&document).expect("JSON is written"), &binary)]
}

pub(crate) fn png() -> Vec<u8> {
    encode_png(2, 2, 4, &[200; 16], photofit_image::PngCompression::default()).expect("encoded")
}

/// The scene of [`glb`].
fn scene() -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("seed.glb");
    std::fs::write(&path, &glb()[0]).expect("written");
    photofit_scene::load(path).expect("the seed is valid")
}

/// Textures as WebP and KTX 2.0 inside of the file.
pub(crate) fn glb_textures() -> Vec<Vec<u8>> {
    let of = |(encoding, magic): (TextureEncoding, &[u8])| {
        let mut scene = scene();
        let texel = |i: u32| [0, 1, 2, 3].map(|c| ((i + c) * i % 251) as u8);
        let image = &mut scene.images[0];
        (image.width, image.height, image.encoded) = (16, 16, None);
        (image.texels, image.encoding) = ((0..16 * 16).map(texel).collect(), encoding);
        // Nothing but colours: a texture that is data too has no KTX 2.0.
        (scene.materials[0].normal_texture, scene.materials[0].occlusion_texture) = (None, None);
        let bytes = photofit_scene::to_glb(&scene).expect("written");
        assert!(bytes.windows(magic.len()).any(|w| w == magic), "the texture is stored as {encoding:?}");
        bytes
    };
    let ktx2 = (TextureEncoding::Ktx2 { quality: 70 }, &b"KTX 20"[..]);
    [(TextureEncoding::WebP, &b"WEBP"[..]), (TextureEncoding::LossyWebP { quality: 70 }, b"WEBP"), ktx2]
        .map(of)
        .into()
}

/// Compressed geometry.
pub(crate) fn glb_meshopt() -> Vec<Vec<u8>> {
    let compressed =
        |precision| photofit_scene::to_glb_with(&scene(), Compression::Meshopt(precision)).expect("written");
    vec![compressed(Precision::Fine), compressed(Precision::Coarse)]
}

/// Primitives compressed by Draco: both methods, both traversals, every attribute.
pub(crate) fn glb_draco() -> Vec<Vec<u8>> {
    vec![
        include_bytes!("../../../../assets/draco/torus-valence.glb").to_vec(),
        include_bytes!("../../../../assets/draco/torus-standard.glb").to_vec(),
        include_bytes!("../../../../assets/draco/torus-sequential.glb").to_vec(),
    ]
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for group in bytes.chunks(3) {
        let n = (0..3).fold(0, |n, k| n << 8 | u32::from(group.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let digit = DIGITS[(n >> (18 - 6 * k) & 63) as usize] as char;
            out.push(if k <= group.len() { digit } else { '=' });
        }
    }
    out
}

pub(crate) fn obj() -> Vec<Vec<u8>> {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 1 .5 .5 .5\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n";
    let faces = "o part\ng one two\ns 1\nusemtl a\nf 1/1/1 2/2/1 3/3/1\nusemtl b\nf 1/1 3/3 4/1\nf -4 -3 -2 -1\nf 1//1 2//1 3//1\n";
    let concave = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .5 0\nv 0 2 0\nf 1 2 3 4 5\n";
    vec![format!("mtllib m.mtl\n{square}{faces}").into_bytes(), concave.into()]
}

pub(crate) const OBJ_OF_MTL: &[u8] = b"mtllib mutant.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 3/1 2/1\n";

pub(crate) fn mtl() -> Vec<Vec<u8>> {
    let maps = "newmtl a\nKd .5 .4 .3\nmap_Kd -s 2 2 1 -o .1 0 -clamp on t.png\nmap_bump -bm .5 t.png\nNs 30\nnewmtl b\n\
        map_Pr t.png\nmap_Pm t.png\nmap_d t.png\nnorm t.png\nKs .1 .1 .1\nNi 1.5\nTf 1 1 1\nillum 7\n";
    vec![MTL.into(), maps.into()]
}

const PCD: &str = "VERSION 0.7\nFIELDS x y z rgb _ normal_x normal_y normal_z\nSIZE 4 8 4 4 1 4 4 4\nTYPE F F F U U F F F\n\
    COUNT 1 1 1 1 3 1 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 1 2 3 0 1 0 0\nPOINTS 4\n";

pub(crate) fn pcd_text() -> Vec<Vec<u8>> {
    let point = |i: u32| format!("{i} 0.5 -{i} 4286595104 9 9 9 0 0 1\n");
    vec![format!("# a comment\n{PCD}DATA ascii\n{}", (0..4).map(point).collect::<String>()).into_bytes()]
}

/// Point by point, and compressed field by field with literals alone.
pub(crate) fn pcd_binary() -> Vec<Vec<u8>> {
    let field = |f: usize, i: u32| match f {
        0 | 2 => (i as f32).to_le_bytes().to_vec(),
        1 => f64::from(i).to_le_bytes().to_vec(),
        3 => 0xff80_4020_u32.to_le_bytes().to_vec(),
        4 => vec![9; 3],
        _ => 1_f32.to_le_bytes().to_vec(),
    };
    let plain = format!("{PCD}DATA binary\n").into_bytes();
    let points = (0..4).flat_map(|i| (0..8).flat_map(move |f| field(f, i)));
    let fields: Vec<u8> = (0..8).flat_map(|f| (0..4).flat_map(move |i| field(f, i))).collect();
    let packed: Vec<u8> =
        fields.chunks(32).flat_map(|c| std::iter::once(c.len() as u8 - 1).chain(c.iter().copied())).collect();
    let mut compressed = format!("{PCD}DATA binary_compressed\n").into_bytes();
    compressed.extend((packed.len() as u32).to_le_bytes());
    compressed.extend((fields.len() as u32).to_le_bytes());
    compressed.extend(packed);
    vec![plain.into_iter().chain(points).collect(), compressed]
}

pub(crate) fn ply_text() -> Vec<Vec<u8>> {
    let head = "ply\nformat ascii 1.0\ncomment made here\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    let body = "0 0 0 0 0 1 10 20 30\n1 0 0 0 0 1 10 20 30\n1 1 0 0 0 1 10 20 30\n0 1 0 0 0 1 10 20 30\n3 0 1 2\n3 0 2 3\n";
    vec![format!("{head}{body}").into_bytes()]
}

pub(crate) fn ply_binary() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (format, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
        let mut file = format!(
            "ply\nformat {format} 1.0\nelement vertex 3\nproperty double x\nproperty float y\nproperty short z\n\
             element face 1\nproperty list uint ushort vertex_indices\nend_header\n"
        )
        .into_bytes();
        let mut put = |little: &[u8]| {
            let mut word = little.to_vec();
            if big {
                word.reverse();
            }
            file.extend(word);
        };
        for (x, y, z) in [(0.0_f64, 0.0_f32, 0_i16), (1.0, 0.0, 2), (0.5, 1.0, -1)] {
            put(&x.to_le_bytes());
            put(&y.to_le_bytes());
            put(&z.to_le_bytes());
        }
        put(&3_u32.to_le_bytes());
        (0..3_u16).for_each(|i| put(&i.to_le_bytes()));
        out.push(file);
    }
    out
}

pub(crate) fn radiance() -> Vec<Vec<u8>> {
    let mut flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    flat.extend([100, 120, 140, 129].repeat(8));
    // Runs: a row of eight texels, one channel after the other.
    let mut runs = b"#?RADIANCE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 8\n".to_vec();
    runs.extend([2, 2, 0, 8]);
    for value in [90, 80, 70, 130] {
        runs.extend([128 + 5, value, 3, value, value, value]);
    }
    vec![flat, runs]
}

pub(crate) fn exr() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("seed.exr");
    let image = Image::from_fn(6, 3, 3, |x, y, c| (x + y + c) as f32);
    photofit_image::write_exr(&path, &[("", &image, &["R", "G", "B"])]).expect("written");
    vec![std::fs::read(path).expect("read")]
}

pub(crate) fn ktx2() -> Vec<Vec<u8>> {
    let texel = |i: u32| [(i * 37 % 256) as u8, (i / 3) as u8, (i * i % 251) as u8, 255 - (i % 7) as u8];
    let level = |side: u32| (side, side, (0..side * side).map(texel).collect());
    let levels = [level(16), level(8), level(4)];
    let options = photofit_ktx2::Options::new(true);
    [None, Some(3)]
        .map(|zstandard| {
            photofit_ktx2::encode(&levels, &photofit_ktx2::Options { zstandard, ..options.clone() })
        })
        .into_iter()
        .map(|file| file.expect("valid levels"))
        .collect()
}

#[cfg(feature = "mitsuba")]
pub(crate) fn mitsuba() -> Vec<Vec<u8>> {
    let more = r##"<scene version="3.0.0">
<default name="spp" value="4"/>
<integrator type="volpath"><integer name="max_depth" value="5"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler></sensor>
<texture type="checkerboard" id="t"><rgb name="color0" value="#ff8800"/><transform name="to_uv"><scale x="2" y="3"/></transform></texture>
<bsdf type="twosided" id="m"><bsdf type="principled"><ref name="base_color" id="t"/><float name="roughness" value="0.3"/></bsdf></bsdf>
<shape type="cube"><ref id="m"/><medium name="interior" type="homogeneous"><float name="albedo" value="0.5"/><rgb name="sigma_t" value="1 2 3"/></medium></shape>
<shape type="shapegroup" id="g"><shape type="disk"/><shape type="cylinder"/></shape>
<shape type="instance"><ref id="g"/><transform name="to_world"><rotate y="1" angle="30"/></transform></shape>
<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
<emitter type="spot"><spectrum name="intensity" value="400:1, 500:2"/></emitter>
<emitter type="spot"><ref name="texture" id="t"/></emitter>
<emitter type="projector"><ref name="irradiance" id="t"/><float name="fov" value="30"/><string name="fov_axis" value="y"/></emitter>
</scene>
"##;
    vec![include_bytes!("../../../../assets/box.xml").to_vec(), more.into()]
}

/// A scene with these elements.
#[cfg(feature = "mitsuba")]
pub(crate) fn mitsuba_scene(body: &str) -> Vec<u8> {
    let sensor =
        "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='8'/></film></sensor>";
    format!("<scene version='3.0.0'>{sensor}{body}</scene>").into_bytes()
}

/// A `serialized` mesh: what its compressed stream holds, and its head.
#[cfg(feature = "mitsuba")]
static SERIALIZED: Packing = Packing {
    unpack: |bytes| {
        use std::io::Read;
        let (head, packed) = bytes.split_at_checked(4)?;
        let mut plain = Vec::new();
        flate2::read::ZlibDecoder::new(packed).read_to_end(&mut plain).ok()?;
        Some(vec![plain, head.to_vec()])
    },
    pack: pack_serialized,
    shapes: &[Shape::Bytes],
};

#[cfg(feature = "mitsuba")]
fn pack_serialized(parts: &[Vec<u8>]) -> Vec<u8> {
    use std::io::Write;
    let mut packer = flate2::write::ZlibEncoder::new(parts[1].clone(), flate2::Compression::fast());
    packer.write_all(&parts[0]).expect("memory takes everything");
    packer.finish().expect("memory takes everything")
}

/// Target, extension, how it is mutated, seeds, elements that name it.
#[cfg(feature = "mitsuba")]
type Named = (&'static str, &'static str, Shape, Vec<Vec<u8>>, &'static str);

/// Files that scenes name.
#[cfg(feature = "mitsuba")]
pub(crate) fn named_by_mitsuba() -> Vec<Named> {
    use photofit_scene::mitsuba::encode_grid;
    let unit = [glam::DVec3::ZERO, glam::DVec3::ONE];
    let grid = |size: [usize; 3], channels: usize, first: f32| {
        let values: Vec<f32> =
            (0..size.iter().product::<usize>() * channels).map(|i| first + 0.05 * i as f32).collect();
        encode_grid(size, &values, unit)
    };
    let mut triangle = 0x1009_u32.to_le_bytes().to_vec();
    triangle.extend(b"name\0");
    triangle.extend(3_u64.to_le_bytes());
    triangle.extend(1_u64.to_le_bytes());
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let normals_and_colors = [[0.0, 0.0, 1.0].repeat(3), vec![0.5; 9]].concat();
    triangle.extend(corners.iter().chain(&normals_and_colors).flat_map(|x| x.to_le_bytes()));
    triangle.extend([0_u32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let mut pfm = b"PF\n4 2\n-1.0\n".to_vec();
    pfm.extend((0..24).flat_map(|i| (i as f32 / 24.0).to_le_bytes()));
    // A bottom-up picture of 3 x 2 pixels, three bytes each, rows of 12 bytes.
    let mut bmp = b"BM".to_vec();
    for word in [78_u32, 0, 54, 40, 3, 2, 1 | 24 << 16, 0, 24, 2835, 2835, 0, 0] {
        bmp.extend(word.to_le_bytes());
    }
    bmp.extend([100; 24]);
    vec![
        ("vol", "vol", Shape::Bytes, vec![grid([2, 3, 2], 1, 0.0), grid([2, 2, 1], 3, 0.0)],
            "<shape type='cube'><bsdf type='null'/><medium name='interior' type='heterogeneous'>
             <volume name='albedo' type='gridvolume'><string name='filename' value='mutant.vol'/></volume></medium></shape>"),
        ("vol-distances", "vol", Shape::Bytes, vec![grid([3, 2, 4], 1, -1.0)],
            "<shape type='sdfgrid'><string name='filename' value='mutant.vol'/></shape>"),
        ("serialized", "serialized", Shape::Packed(&SERIALIZED), vec![pack_serialized(&[triangle, b"\x1c\x04\x04\0".to_vec()])],
            "<shape type='serialized'><string name='filename' value='mutant.serialized'/></shape>"),
        ("spectrum", "spd", Shape::Text, vec![b"# metal\n400 .2\n500.5 0.31\n600 1e-1\n700 .95\n".to_vec(), b"360 1\n830 2\n".to_vec()],
            "<shape type='cube'><bsdf type='diffuse'><spectrum name='reflectance' filename='mutant.spd'/></bsdf></shape>"),
        ("pfm", "pfm", Shape::Bytes, vec![pfm], "<shape type='cube'><bsdf type='diffuse'><texture name='reflectance' type='bitmap'><string name='filename' value='mutant.pfm'/></texture></bsdf></shape>"),
        ("bmp", "bmp", Shape::Bytes, vec![bmp],
            "<shape type='cube'><bsdf type='diffuse'><texture name='reflectance' type='bitmap'><string name='filename' value='mutant.bmp'/></texture></bsdf></shape>"),
    ]
}
