// Shared by rasterization and the forms of its backward pass: bindings, assignment of threads to pixels,
// evaluation of splats, and a tile's list in workgroup memory.

@group(0) @binding(1) var<storage, read> tile_ranges: array<vec2<u32>>;
// Concatenated tile lists: splat and entry.
@group(0) @binding(2) var<storage, read> items: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> rays: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
// Per splat: colour, then features.
@group(0) @binding(5) var<storage, read> channels: array<f32>;
// The rendered image: colour (HWC, background included), then the transmittance, then the feature planes. A
// gradient by it has the same layout; that of the transmittance is ignored.
@group(0) @binding(6) var<storage, read_write> image: array<f32>;

@group(0) @binding(6) var<storage, read> rendered: array<f32>;
@group(0) @binding(7) var<storage, read> upstream: array<f32>;
// Sums over a splat's pixels in a tile, ENTRY_SUMS per entry: of dL/d(ln alpha), of ten of its moments that
// depend on the shape (see `moments_of`), by the channels.
@group(0) @binding(8) var<storage, read_write> entry_sums: array<f32>;

// By rank, near to far.
@group(0) @binding(1) var<storage, read> sorted_keys: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entry_starts: array<u32>;
@group(0) @binding(5) var<storage, read> all_entry_sums: array<f32>;
// SUMS per splat; see project.wgsl.
@group(0) @binding(6) var<storage, read_write> splat_gradients: array<f32>;

fn pixel_count() -> u32 {
    return view.width * view.height;
}

// Pixel of a thread.
struct Pixel {
    column: u32,
    row: u32,
    index: u32,
    is_inside: bool,
}

// Index in an image of a pixel's value of a channel.
fn place_of(pixel: u32, channel: u32) -> u32 {
    return select((channel + 1u) * pixel_count() + pixel, pixel * 3u + channel, channel < 3u);
}

// Threads take the pixels of a tile in blocks of 8 x 8. Threads that run together thus have neighbouring
// pixels in both directions, of which a splat covers all or none more often than of long rows.
const BLOCK_SIDE: u32 = 8u;

fn pixel_of(tile: u32, thread: u32) -> Pixel {
    let columns = (view.width + TILE - 1u) / TILE;
    let block = thread / (BLOCK_SIDE * BLOCK_SIDE);
    let blocks = TILE / BLOCK_SIDE;
    let column = (tile % columns) * TILE + (block % blocks) * BLOCK_SIDE + thread % BLOCK_SIDE;
    let row = (tile / columns) * TILE + (block / blocks) * BLOCK_SIDE
        + thread / BLOCK_SIDE % BLOCK_SIDE;
    return Pixel(
        column,
        row,
        row * view.width + column,
        column < view.width && row < view.height,
    );
}

// Terms of q in a pixel.
struct Geometry {
    q: f32,
    // Ellipse: offset along the row from the row's mean, and offset in rows from the centre. Cone: f_1.r,
    // f_2.r.
    offset: vec2<f32>,
    // Cone: the ray, l, N and l^2 + eps N.
    ray: vec3<f32>,
    along: f32,
    n: f32,
    denominator: f32,
}

fn geometry_of(splat: Splat, pixel: Pixel) -> Geometry {
    if splat.shape == ELLIPSE {
        var offset = vec2(f32(pixel.column), f32(pixel.row)) + 0.5 - splat.centre;
        if view.camera == ERP {
            // The shorter way around the seam.
            let width = f32(view.width);
            offset.x -= width * (f32(offset.x > 0.5 * width) - f32(offset.x < -0.5 * width));
        }
        offset.x -= splat.first.y * offset.y;
        let q = offset.x * offset.x * splat.first.x + offset.y * offset.y * splat.first.z;
        return Geometry(q, offset, vec3<f32>(), 0.0, 0.0, 0.0);
    }
    let ray = ray_through(pixel.column, pixel.row);
    let offset = vec2(dot(splat.first, ray), dot(splat.second, ray));
    let along = max(dot(splat.third, ray), 0.0);
    let n = dot(offset, offset);
    let denominator = along * along + splat.depth_variance * n;
    // Effectively infinite behind the camera, so that alpha is zero.
    var q = 1e30;
    if n < 1e4 * denominator {
        q = n / denominator;
    }
    return Geometry(q, offset, ray, along, n, denominator);
}

// Moments of dL/d(ln alpha) for a splat's shape. Ellipse: x, y, x^2, xy, y^2. Cone: with D = l^2 + eps N,
// dq/dN = l^2 / D^2, dq/dl = -2 l N / D^2, dq/deps = -N^2 / D^2.
fn moments_of(splat: Splat, at: Geometry, by_log: f32) -> array<f32, MOMENTS> {
    if splat.shape == ELLIPSE {
        let x = by_log * at.offset.x;
        let y = by_log * at.offset.y;
        return array(x, y, x * at.offset.x, y * at.offset.x, y * at.offset.y, 0.0, 0.0, 0.0, 0.0, 0.0);
    }
    let by_square = by_log / (at.denominator * at.denominator);
    let by_n = -by_square * at.along * at.along;
    let by_first = by_n * at.offset.x * at.ray;
    let by_second = by_n * at.offset.y * at.ray;
    let by_third = by_square * at.n * at.along * at.ray;
    return array(
        by_first.x,
        by_first.y,
        by_first.z,
        by_second.x,
        by_second.y,
        by_second.z,
        by_third.x,
        by_third.y,
        by_third.z,
        0.5 * by_square * at.n * at.n,
    );
}

// Effect of a splat on a pixel.
struct Blend {
    alpha: f32,
    // Opacity before the clamp at 0.99, which the gradient ignores.
    unclamped: f32,
    // T alpha
    weight: f32,
}

// Blends a splat of this opacity into a pixel that has not stopped, unless the pixel must stop before it. `q`
// is that of the pixel.
fn blend(
    opacity: f32,
    q: f32,
    transmittance: ptr<function, f32>,
    alive: ptr<function, bool>,
) -> Blend {
    let unclamped = opacity * exp(-0.5 * q);
    let alpha = min(unclamped, ALPHA_MAX);
    if alpha < ALPHA_MIN {
        return Blend();
    }
    let next = *transmittance * (1.0 - alpha);
    if next < TRANSMITTANCE_MIN {
        *alive = false;
        return Blend();
    }
    let weight = *transmittance * alpha;
    *transmittance = next;
    return Blend(alpha, unclamped, weight);
}

// Maximum number of moments of dL/d(ln alpha) for a shape.
const MOMENTS: u32 = 10u;
// Number of moments of an ellipse.
const ELLIPSE_MOMENTS: u32 = 5u;
// Splats that a workgroup loads together.
const BATCH: u32 = 64u;

var<workgroup> batch_splats: array<Splat, BATCH>;
var<workgroup> batch_channels: array<f32, BATCH * CHANNELS>;
var<workgroup> alive_count: atomic<u32>;
var<workgroup> alive_at_start: u32;

// True if any pixel of the tile has not stopped; the same in all threads.
fn any_alive(thread: u32) -> bool {
    workgroupBarrier();
    if thread == 0u {
        alive_at_start = atomicLoad(&alive_count);
    }
    return workgroupUniformLoad(&alive_at_start) > 0u;
}

// Stages `count` splats of a tile's list for all of its threads.
fn load_batch(thread: u32, begin: u32, count: u32) {
    if thread < count {
        batch_splats[thread] = splats[items[begin + thread].x];
    }
    for (var value = thread; value < count * CHANNELS; value += WORKGROUP) {
        let number = items[begin + value / CHANNELS].x;
        batch_channels[value] = channels[number * CHANNELS + value % CHANNELS];
    }
    workgroupBarrier();
}

// Inputs of a pixel in the backward pass.
struct Upstream {
    // dL/dC
    by_channel: array<f32, CHANNELS>,
    // Contribution of the splats behind and of the background to dL/dC . C; initially of all splats.
    behind: f32,
}

fn upstream_of(pixel: Pixel) -> Upstream {
    var found: Upstream;
    if pixel.is_inside {
        for (var channel = 0u; channel < CHANNELS; channel++) {
            let place = place_of(pixel.index, channel);
            found.by_channel[channel] = upstream[place];
            found.behind += upstream[place] * rendered[place];
        }
    }
    return found;
}

// Writes zeros for the rest of a tile's list once all pixels have stopped.
fn leave_out(thread: u32, begin: u32, list_end: u32) {
    if begin >= list_end {
        return;
    }
    for (var value = thread; value < (list_end - begin) * ENTRY_SUMS; value += WORKGROUP) {
        let entry = items[begin + value / ENTRY_SUMS].y;
        entry_sums[entry * ENTRY_SUMS + value % ENTRY_SUMS] = 0.0;
    }
}
