//! Clip of frames and masks, from its import to edits of its atlas.

use std::{
    fs,
    path::{Path, PathBuf},
};

use image::{GrayImage, Luma, Rgb, RgbImage};

use crate::support::{SEQUENCE, omnilife, read_image, scratch, small_run};

const SIZE: [u32; 2] = [64, 40];
const FRAMES: u32 = 6;

/// Writes a square that crosses a pattern, with its masks.
fn write_clip(folder: &Path) {
    let [width, height] = SIZE;
    for name in ["rgb", "objects/square"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    for frame in 0..FRAMES {
        let is_it =
            |x: u32, y: u32| (14 + 4 * frame..26 + 4 * frame).contains(&x) && (14..26).contains(&y);
        let rgb = RgbImage::from_fn(width, height, |x, y| {
            let wave = |at: f64| (128.0 + 90.0 * at.sin()) as u8;
            let (a, b) = (f64::from(x) * 0.3, f64::from(y) * 0.4);
            if is_it(x, y) {
                Rgb([220, 40, 60])
            } else {
                Rgb([wave(a + b), wave(a - b), wave(b)])
            }
        });
        rgb.save(folder.join(format!("rgb/{frame:05}.png")))
            .unwrap();
        let mask = GrayImage::from_fn(width, height, |x, y| Luma([255 * u8::from(is_it(x, y))]));
        mask.save(folder.join(format!("objects/square/{frame:05}.png")))
            .unwrap();
    }
}

/// Runs the binary with words as arguments.
fn run(words: &str) -> crate::support::Ended {
    omnilife(words.split_whitespace())
}

/// Makes a small run on the clip; returns its folder, and the scene.
fn small_atlas(folder: &Path) -> (PathBuf, PathBuf) {
    let (clip, scene, out) = (
        folder.join("clip"),
        folder.join("scene"),
        folder.join("run"),
    );
    write_clip(&clip);
    run(&format!(
        "curate import {} --format frames --id square --fps 10 --out {}",
        clip.display(),
        scene.display()
    ))
    .succeeded();
    let record = scene.join("scene.json");
    let split = scene.join("split.json");
    run(&format!(
        "bench split {} --protocol input-view --out {}",
        record.display(),
        split.display()
    ))
    .succeeded();
    run(&format!(
        "reconstruct train {} --split {} --method nag --iterations 40 --set rays=1024 --set \
         base-fields=tiny --set motion-fields=tiny --out {}",
        record.display(),
        split.display(),
        out.display()
    ))
    .succeeded();
    (out, record)
}

fn edit(run_folder: &Path, script: &str, out: &Path) -> crate::support::Ended {
    let path = out.with_extension("toml");
    fs::write(&path, script).unwrap();
    run(&format!(
        "reconstruct edit {} --script {} --out {}",
        run_folder.display(),
        path.display(),
        out.display()
    ))
}

#[test]
fn a_clip_is_imported_learnt_scored_taken_apart_and_edited() {
    let folder = scratch();
    let folder = folder.path();
    let (atlas, scene) = small_atlas(folder);
    let text = fs::read_to_string(&scene).unwrap();
    assert!(text.contains("a still camera") && text.contains("masks/square/00003.png"));
    for file in [
        "run.json",
        "trace.csv",
        "predictions/input/000003.png",
        "atlas.json",
        "atlas.bin",
    ] {
        assert!(atlas.join(file).is_file(), "{file}");
    }
    let split = scene.with_file_name("split.json");
    run(&format!(
        "bench score --scene {} --split {} --run {} --out {}",
        scene.display(),
        split.display(),
        atlas.join("run.json").display(),
        folder.join("score").display()
    ))
    .succeeded();
    let result = fs::read_to_string(folder.join("score/result.json")).unwrap();
    assert!(result.contains("psnr-object") && result.contains("ssim-skimage-uniform"));
    let render = |run_folder: &Path, layer: &str, name: &str| {
        let out = folder.join(name);
        let ended = run(&format!(
            "reconstruct render {} --poses {} --layer {layer} --out {}",
            run_folder.display(),
            scene.display(),
            out.display()
        ));
        (ended, out.join("000003.png"))
    };
    let (ended, all) = render(&atlas, "all", "all");
    ended.succeeded();
    assert_eq!(
        read_image(&all),
        read_image(&atlas.join("predictions/input/000003.png"))
    );
    let (ended, matte) = render(&atlas, "matte:square", "matte");
    ended.succeeded();
    let matte = read_image(&matte);
    // In frame 3 the square's middle is at (32, 20).
    assert!(matte[(32, 20)][0] > 200 && matte[(5, 5)][0] < 50);
    // An object over the view without it is the view: nothing is in front of the square.
    let (ended, object) = render(&atlas, "object:square", "object");
    ended.succeeded();
    let object = image::open(&object).unwrap();
    assert!(object.color().has_alpha());
    let object = object.to_rgba8();
    assert!(object[(32, 20)][3] > 200 && object[(5, 5)][3] < 50);
    let (ended, without) = render(&atlas, "without:square", "without");
    ended.succeeded();
    let (without, whole) = (read_image(&without), read_image(&all));
    for (x, y, pixel) in object.enumerate_pixels() {
        let alpha = f64::from(pixel[3]) / 255.0;
        for channel in 0..3 {
            let behind = f64::from(without[(x, y)][channel]);
            let over = alpha * f64::from(pixel[channel]) + (1.0 - alpha) * behind;
            let off = over - f64::from(whole[(x, y)][channel]);
            assert!(off.abs() < 2.0, "{x}, {y}: {off}");
        }
    }
    let (ended, _) = render(&atlas, "object:swan", "none");
    let message = ended.failed_quietly(2).to_owned();
    assert!(
        message.contains("swan") && message.contains("square"),
        "{message}"
    );
    run(&format!(
        "reconstruct atlas {} --out {}",
        atlas.display(),
        folder.join("atlas").display()
    ))
    .succeeded();
    let square = image::open(folder.join("atlas/square.png"))
        .unwrap()
        .to_rgba8();
    let middle = square[(square.width() / 2, square.height() / 2)];
    assert!(
        middle[0] > 150 && middle[1] < 110 && middle[3] > 128,
        "{middle:?}"
    );

    // There and back again is the original position; without it the background is visible.
    let there = "[[edit]]\nkind = \"shift\"\nnode = \"square\"\nby = [0.1, 0.0, 0.0]\n";
    let back = there.replace("0.1, 0.0", "-0.1, 0.0");
    edit(&atlas, &format!("{there}{back}"), &folder.join("back")).succeeded();
    let (ended, returned) = render(&folder.join("back"), "all", "returned");
    ended.succeeded();
    let largest = read_image(&returned)
        .iter()
        .zip(read_image(&all).iter())
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(largest <= Some(1), "{largest:?}");
    edit(
        &atlas,
        "[[edit]]\nkind = \"remove\"\nnode = \"square\"\n",
        &folder.join("removed"),
    )
    .succeeded();
    let (ended, removed) = render(&folder.join("removed"), "all", "without-it");
    ended.succeeded();
    let (ended, without) = render(&atlas, "without:square", "without");
    ended.succeeded();
    assert_eq!(read_image(&removed), read_image(&without));
    assert!(read_image(&removed)[(32, 20)] != read_image(&all)[(32, 20)]);
    let record = fs::read_to_string(folder.join("removed/run.json")).unwrap();
    assert!(record.contains("square is removed"));
    // The guessed part of the clean plate is marked.
    assert!(record.contains("background-unseen.png"));
    let unseen = image::open(folder.join("removed/background-unseen.png")).unwrap();
    let plate = image::open(folder.join("atlas/background.png")).unwrap();
    assert_eq!(
        unseen.to_luma8().dimensions(),
        plate.to_rgba8().dimensions()
    );

    edits_are_shown_in_one_command(folder, &atlas, &scene);

    // An image, and an object of a run, stand where the square is.
    image::RgbaImage::from_pixel(8, 8, image::Rgba([20, 20, 240, 255]))
        .save(folder.join("blue.png"))
        .unwrap();
    let insert = "[[edit]]\nkind = \"insert\"\nnode = \"square\"\n";
    let removal = "[[edit]]\nkind = \"remove\"\nnode = \"square\"\n";
    for (what, name, channel) in [
        ("new = \"logo\"\nimage = \"blue.png\"\n", "logo", 2),
        (
            "new = \"twin\"\nrun = \"run\"\nfrom = \"square\"\n",
            "twin",
            0,
        ),
    ] {
        let script = format!("{insert}{what}{removal}");
        edit(&atlas, &script, &folder.join(name)).succeeded();
        let (ended, shown) = render(&folder.join(name), "all", &format!("{name}-views"));
        ended.succeeded();
        let middle = read_image(&shown)[(32, 20)];
        assert!(
            middle[channel] > 150 && middle[1] < 110,
            "{name}: {middle:?}"
        );
    }

    // A painted frame returns at its painted position.
    let mut paint = image::RgbaImage::new(SIZE[0], SIZE[1]);
    for x in 29..36 {
        for y in 17..24 {
            paint.put_pixel(x, y, image::Rgba([0, 255, 0, 255]));
        }
    }
    paint.save(folder.join("green.png")).unwrap();
    let script =
        "[[edit]]\nkind = \"texture\"\nnode = \"square\"\nimage = \"green.png\"\nframe = 3\n";
    let ended = edit(&atlas, script, &folder.join("painted")).succeeded();
    assert!(
        ended.stdout.contains("within half a pixel"),
        "{}",
        ended.stdout
    );
    let (ended, painted) = render(&folder.join("painted"), "all", "green");
    ended.succeeded();
    let painted = read_image(&painted);
    assert!(painted[(32, 20)][1] > 180, "{:?}", painted[(32, 20)]);
}

/// Previews a removal, and renders it as images and video, beside the edited run and its views at `folder`.
fn edits_are_shown_in_one_command(folder: &Path, atlas: &Path, scene: &Path) {
    let edit = |further: &str, name: &str| {
        let out = folder.join(name);
        let script = folder.join("removed.toml");
        let ended = run(&format!(
            "reconstruct edit {} --script {} --poses {} {further} --out {}",
            atlas.display(),
            script.display(),
            scene.display(),
            out.display()
        ));
        (ended, out)
    };
    let (ended, preview) = edit("--preview 3", "preview");
    let ended = ended.succeeded();
    assert!(ended.stdout.contains("square is removed"));
    // Nothing is looked for that only a kept run tells.
    assert!(
        !ended.stderr.contains("background-unseen.png"),
        "{}",
        ended.stderr
    );
    let half = folder.join("half");
    run(&format!(
        "reconstruct render {} --poses {} --frame 3 --size 32x20 --out {}",
        folder.join("removed").display(),
        scene.display(),
        half.display()
    ))
    .succeeded();
    let image = read_image(&preview.join("000003.png"));
    assert_eq!(image.dimensions(), (SIZE[0] / 2, SIZE[1] / 2));
    assert_eq!(image, read_image(&half.join("000003.png")));
    // It is an image, and no run.
    let names = fs::read_dir(&preview).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let visible: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
    assert_eq!(visible, ["000003.png"]);
    let film = folder.join("removed.mp4");
    let (ended, shown) = edit(&format!("--video {}", film.display()), "shown");
    ended.succeeded();
    assert!(film.is_file() && shown.join("run.json").is_file());
    assert_eq!(
        read_image(&shown.join("views/000003.png")),
        read_image(&folder.join("without-it/000003.png"))
    );
    let (ended, _) = edit("--preview 99", "beyond");
    let message = ended.failed_quietly(2).to_owned();
    assert!(message.contains("has no frame 99"), "{message}");
}

#[test]
fn wrong_scripts_and_clips_are_one_line_each() {
    let folder = scratch();
    let folder = folder.path();
    let (atlas, _) = small_atlas(folder);
    image::RgbaImage::new(4, 4)
        .save(folder.join("empty.png"))
        .unwrap();
    for (script, expected) in [
        (
            "[[edit]]\nkind = \"remove\"\nnode = \"swan\"\n",
            "line 1: the object must be",
        ),
        (
            "[[edit]]\nkind = \"remove\"\nnode = \"square\"\n\n[[edit]]\nkind = \"texture\"\nnode = \"background\"\nimage = \"empty.png\"\n",
            "line 5",
        ),
        ("[[edit]]\nkind = \"paint\"\nnode = \"square\"\n", "paint"),
        (
            "[[edit]]\nkind = \"texture\"\nnode = \"square\"\nimage = \"none.png\"\n",
            "none.png",
        ),
    ] {
        let ended = edit(&atlas, script, &folder.join("edited"));
        let message = ended.failed_quietly(2).to_owned();
        assert!(message.contains(expected), "{message}");
        assert!(!folder.join("edited/run.json").exists());
    }
    // Gaussians have no parts.
    let gaussians = small_run().out.join(crate::support::METHOD).join("run");
    let message = edit(
        &gaussians,
        "[[edit]]\nkind = \"remove\"\nobject = \"3\"\n",
        &folder.join("edited"),
    )
    .failed_quietly(2)
    .to_owned();
    assert!(message.contains("no parts to edit"), "{message}");
    let import = |name: &str, spoil: &dyn Fn(&Path)| {
        let clip = folder.join(name);
        write_clip(&clip);
        spoil(&clip);
        let out = folder.join(format!("{name}-scene"));
        let ended = run(&format!(
            "curate import {} --format frames --fps 10 --out {}",
            clip.display(),
            out.display()
        ));
        assert!(!out.join("scene.json").exists());
        ended.failed_quietly(2).to_owned()
    };
    let message = import("size", &|clip| {
        let mask = GrayImage::new(8, 8);
        mask.save(clip.join("objects/square/00002.png")).unwrap();
    });
    assert!(message.contains("00002.png"), "{message}");
    let message = import("orphan", &|clip| {
        let mask = GrayImage::new(SIZE[0], SIZE[1]);
        mask.save(clip.join("objects/square/00099.png")).unwrap();
    });
    assert!(message.contains("the mask of no frame"), "{message}");
    let message = import("focal", &|clip| {
        fs::write(clip.join("camera.json"), "{\"focal\": -3}").unwrap();
    });
    assert!(
        message.contains("camera.json") && message.contains("focal"),
        "{message}"
    );
}

/// Scenes of the sphere have a sphere as background; scenes of the first version are read too.
#[test]
fn panoramas_have_a_sphere_as_background() {
    let sequence = small_run().out.join(SEQUENCE);
    let folder = scratch();
    let out = folder.path().join("run");
    run(&format!(
        "reconstruct train {} --split {} --method nag --iterations 30 --set rays=512 --set \
         base-fields=tiny --set motion-fields=tiny --out {}",
        sequence.join("scene.json").display(),
        sequence.join("per-scene/split.json").display(),
        out.display()
    ))
    .succeeded();
    let record = fs::read_to_string(out.join("run.json")).unwrap();
    assert!(record.contains("a sphere (panoramas)"));
    assert!(out.join("predictions/novel/000004.png").is_file());
    let message = run(&format!(
        "reconstruct train {} --split {} --method nag --set gradients=published --backend gpu \
         --out {}",
        sequence.join("scene.json").display(),
        sequence.join("per-scene/split.json").display(),
        folder.path().join("gpu").display()
    ));
    let message = message.failed_quietly(2).to_owned();
    let is_told = message.contains("gradients=published") || message.contains("there is no GPU");
    assert!(is_told, "{message}");
}
