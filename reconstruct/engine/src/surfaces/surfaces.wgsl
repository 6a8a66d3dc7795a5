// Appearance of surfaces at hits, and its gradients: flow, textures, and what fields add to them.

struct Surface {
    // Number of its samples, and index of the first among the layers of all surfaces.
    samples: u32,
    first: u32,
    // 2 on a plane, 3 on the sphere.
    dimensions: u32,
    // 1 if it has opacities; otherwise it is opaque.
    has_opacity: u32,
    // Outputs of the evaluated fields, 0 for others.
    colour_outputs: u32,
    opacity_outputs: u32,
    flow_outputs: u32,
    view_outputs: u32,
    colour_size: vec2<u32>,
    opacity_size: vec2<u32>,
}

// A hit.
struct Sample {
    // Position on the plane, or unit direction from the sphere's centre.
    place: vec3<f32>,
    moment: u32,
    // View angle as coordinates in the unit square.
    angle: vec2<f32>,
}

// Control points of the flow at a moment.
struct MomentKnots {
    knots: vec4<u32>,
    weights: vec4<f32>,
}

// What the backward pass needs of a sample: derivatives of the textures by the query, and the colour before it is
// clamped.
struct Appearance {
    by_query: array<vec4<f32>, 3>,
    // Derivative of the base opacity's logit, and the opacity.
    opacity: vec4<f32>,
}

@group(0) @binding(0) var<uniform> surface: Surface;
@group(0) @binding(1) var<storage, read> samples: array<Sample>;

@group(0) @binding(2) var<storage, read_write> flow_positions: array<f32>;

@group(0) @binding(2) var<storage, read> moments: array<MomentKnots>;
@group(0) @binding(3) var<storage, read> flow: array<f32>;
@group(0) @binding(4) var<storage, read_write> queries: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> colour_positions: array<f32>;
@group(0) @binding(6) var<storage, read_write> opacity_positions: array<f32>;
@group(0) @binding(7) var<storage, read_write> view_positions: array<f32>;
@group(0) @binding(8) var<storage, read_write> flows: array<vec4<f32>>;

@group(0) @binding(1) var<storage, read> shaded_queries: array<vec4<f32>>;
// The colours' texels, then those of the opacities.
@group(0) @binding(2) var<storage, read> texels: array<f32>;
@group(0) @binding(3) var<storage, read> colours: array<f32>;
@group(0) @binding(4) var<storage, read> logits: array<f32>;
@group(0) @binding(5) var<storage, read> views: array<f32>;
@group(0) @binding(6) var<storage, read_write> layers: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> appearances: array<Appearance>;

@group(0) @binding(1) var<storage, read> shaded: array<Appearance>;
@group(0) @binding(2) var<storage, read> by_layers: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> by_colours: array<f32>;
@group(0) @binding(4) var<storage, read_write> by_logits: array<f32>;
@group(0) @binding(5) var<storage, read_write> by_views: array<f32>;
// Gradients by the query, later by the place, and by the angle's coordinates.
@group(0) @binding(6) var<storage, read_write> by_samples: array<f32>;

@group(0) @binding(3) var<storage, read> flows_before: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> by_flow: array<f32>;
@group(0) @binding(5) var<storage, read_write> moved_samples: array<f32>;

const TAU: f32 = 6.28318530717959;
const PI: f32 = 3.14159265358979;

// Values beyond the outermost texels.
const BEYOND_ZERO: u32 = 0u;
const BEYOND_BORDER: u32 = 1u;
const BEYOND_SPHERE: u32 = 2u;

// Coordinates of a query as input of a field.
fn coordinates(query: vec3<f32>) -> vec3<f32> {
    return select(query, 0.5 * (query + 1.0), surface.dimensions == 3u);
}

// Inputs of the flow field; one thread per sample and dimension.
@compute @workgroup_size(256)
fn place_samples(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    let row = index / surface.dimensions;
    if row >= surface.samples || surface.flow_outputs == 0u {
        return;
    }
    flow_positions[index] = coordinates(samples[row].place)[index % surface.dimensions];
}

// The flow at a sample's moment, between control points.
fn flow_of(row: u32, moment: u32) -> vec3<f32> {
    var sum = vec3<f32>();
    if surface.flow_outputs == 0u {
        return sum;
    }
    let knots = moments[moment];
    for (var index = 0u; index < 4u; index++) {
        let point = row * surface.flow_outputs + knots.knots[index] * surface.dimensions;
        var value = vec3(flow[point], flow[point + 1u], 0.0);
        if surface.dimensions == 3u {
            value.z = flow[point + 2u];
        }
        sum += knots.weights[index] * value;
    }
    return sum;
}

// A place on the sphere after the flow, before it is normalized.
fn moved_on_sphere(place: vec3<f32>, by: vec3<f32>) -> vec3<f32> {
    return place + FIELD_WEIGHT * (by - dot(by, place) * place);
}

// Moves places by the flow: queries, and the inputs of the other fields.
@compute @workgroup_size(256)
fn move_samples(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= surface.samples {
        return;
    }
    let at = samples[row];
    let by = flow_of(row, at.moment);
    var query = at.place + FIELD_WEIGHT * by;
    if surface.dimensions == 3u {
        query = normalize(moved_on_sphere(at.place, by));
    }
    queries[row] = vec4(query, 0.0);
    flows[row] = vec4(by, 0.0);
    let inputs = coordinates(query);
    for (var axis = 0u; axis < surface.dimensions; axis++) {
        let index = row * surface.dimensions + axis;
        if surface.colour_outputs > 0u {
            colour_positions[index] = inputs[axis];
        }
        if surface.opacity_outputs > 0u {
            opacity_positions[index] = inputs[axis];
        }
    }
    if surface.view_outputs > 0u {
        view_positions[4u * row] = query.x;
        view_positions[4u * row + 1u] = query.y;
        view_positions[4u * row + 2u] = at.angle.x;
        view_positions[4u * row + 3u] = at.angle.y;
    }
}

// Position between texels: whole numbers are their centres.
struct TexturePlace {
    column: i32,
    row: i32,
    share: vec2<f32>,
}

fn texture_place(at: vec2<f32>) -> TexturePlace {
    let whole = floor(at);
    return TexturePlace(i32(whole.x), i32(whole.y), at - whole);
}

// Index of a texel; -1 for zeros.
fn texel_of(asked: vec2<i32>, size: vec2<i32>, beyond: u32) -> i32 {
    var column = asked.x;
    var row = asked.y;
    if beyond == BEYOND_SPHERE {
        if row < 0 || row >= size.y {
            row = select(2 * size.y - 1 - row, -1 - row, row < 0);
            column += size.x / 2;
        }
        column = ((column % size.x) + size.x) % size.x;
    } else if beyond == BEYOND_ZERO {
        if column < 0 || column >= size.x || row < 0 || row >= size.y {
            return -1;
        }
    }
    column = clamp(column, 0, size.x - 1);
    row = clamp(row, 0, size.y - 1);
    return row * size.x + column;
}

// The four texels around a position.
fn texels_around(place: TexturePlace, size: vec2<u32>, beyond: u32) -> vec4<i32> {
    let whole = vec2<i32>(size);
    let at = vec2(place.column, place.row);
    return vec4(
        texel_of(at, whole, beyond),
        texel_of(at + vec2(1, 0), whole, beyond),
        texel_of(at + vec2(0, 1), whole, beyond),
        texel_of(at + vec2(1, 1), whole, beyond),
    );
}

fn texel(first: u32, width: u32, channel: u32, number: i32) -> f32 {
    if number < 0 {
        return 0.0;
    }
    return texels[first + u32(number) * width + channel];
}

// A channel's value, and its derivatives by the position in texels.
fn interpolated(
    first: u32,
    width: u32,
    channel: u32,
    around: vec4<i32>,
    share: vec2<f32>,
) -> vec3<f32> {
    let a = texel(first, width, channel, around.x);
    let b = texel(first, width, channel, around.y);
    let c = texel(first, width, channel, around.z);
    let d = texel(first, width, channel, around.w);
    let upper = (1.0 - share.x) * a + share.x * b;
    let lower = (1.0 - share.x) * c + share.x * d;
    return vec3(
        (1.0 - share.y) * upper + share.y * lower,
        (1.0 - share.y) * (b - a) + share.y * (d - c),
        (1.0 - share.x) * (c - a) + share.x * (d - b),
    );
}

// Texels per unit of a plane's coordinates.
fn texels_per_unit(size: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(max(size, vec2(1u)) - vec2(1u));
}

// Position in a plane's texture; further away than one side all positions read the same texels.
fn on_plane(query: vec3<f32>, size: vec2<u32>) -> TexturePlace {
    return texture_place(clamp(query.xy, vec2(-2.0), vec2(3.0)) * texels_per_unit(size));
}

// Position in the texture of a direction.
fn on_sphere(query: vec3<f32>, size: vec2<u32>) -> TexturePlace {
    let longitude = arc_tangent(query.x, query.z);
    let latitude = arc_tangent(-query.y, length(query.xz));
    let extent = vec2<f32>(size);
    let shares = vec2(longitude / TAU + 0.5, 0.5 - latitude / PI);
    return texture_place(shares * extent - 0.5);
}

// Derivative by a query from those by the position in texels.
fn by_query_of(query: vec3<f32>, size: vec2<u32>, by_texels: vec2<f32>) -> vec3<f32> {
    if surface.dimensions == 2u {
        return vec3(by_texels * texels_per_unit(size), 0.0);
    }
    let across = length(query.xz);
    var sin_cos = vec2(0.0, 1.0);
    if across > 0.0 {
        sin_cos = query.xz / across;
    }
    let along = by_texels.x * f32(size.x) / TAU / max(across, 1e-6);
    let down = by_texels.y * f32(size.y) / PI;
    return along * vec3(sin_cos.y, 0.0, -sin_cos.x)
        + down * vec3(-query.y * sin_cos.x, across, -query.y * sin_cos.y);
}

// What the fields add to a channel of the colour, or to the opacity's logit (channel 3).
fn added(row: u32, channel: u32) -> f32 {
    var sum = 0.0;
    if channel < surface.colour_outputs {
        sum += colours[row * surface.colour_outputs + channel];
    }
    if channel == 3u && surface.opacity_outputs > 0u {
        sum += logits[row];
    }
    if channel < surface.view_outputs {
        sum += views[row * surface.view_outputs + channel];
    }
    return FIELD_WEIGHT * sum;
}

// Adds the fields' outputs to the textures: a layer of its ray.
@compute @workgroup_size(256)
fn shade(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= surface.samples {
        return;
    }
    let query = shaded_queries[row].xyz;
    let size = surface.colour_size;
    var place = on_plane(query, size);
    var beyond = select(BEYOND_BORDER, BEYOND_ZERO, surface.has_opacity != 0u);
    if surface.dimensions == 3u {
        place = on_sphere(query, size);
        beyond = BEYOND_SPHERE;
    }
    let around = texels_around(place, size, beyond);
    var appearance: Appearance;
    var colour = vec3<f32>();
    for (var channel = 0u; channel < 3u; channel++) {
        let read = interpolated(0u, 3u, channel, around, place.share);
        let unclamped = read.x + added(row, channel);
        colour[channel] = clamp(unclamped, 0.0, 1.0);
        appearance.by_query[channel] = vec4(by_query_of(query, size, read.yz), unclamped);
    }
    var opacity = 1.0;
    appearance.opacity = vec4(0.0, 0.0, 0.0, 1.0);
    if surface.has_opacity != 0u {
        let opacity_size = surface.opacity_size;
        let opacity_place = on_plane(query, opacity_size);
        let texels = texels_around(opacity_place, opacity_size, BEYOND_BORDER);
        let read = interpolated(3u * size.x * size.y, 1u, 0u, texels, opacity_place.share);
        let share = clamp(read.x, 1e-4, 1.0 - 1e-4);
        let whole = log(share / (1.0 - share)) + added(row, 3u);
        opacity = 1.0 / (1.0 + exp(-whole));
        let by_query = by_query_of(query, opacity_size, read.yz) / (share * (1.0 - share));
        appearance.opacity = vec4(by_query, opacity);
    }
    layers[surface.first + row] = vec4(colour, opacity);
    appearances[row] = appearance;
}

// Gradients by the fields' outputs and by the query, from those by a layer.
@compute @workgroup_size(256)
fn shade_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= surface.samples {
        return;
    }
    let appearance = shaded[row];
    let by_layer = by_layers[surface.first + row];
    var by_query = vec3<f32>();
    for (var channel = 0u; channel < 3u; channel++) {
        let of_channel = appearance.by_query[channel];
        let unclamped = of_channel.w;
        var by = by_layer[channel];
        // A clamped colour has a gradient only if it points inwards.
        if (unclamped < 0.0 && by > 0.0) || (unclamped > 1.0 && by < 0.0) {
            by = 0.0;
        }
        by_query += by * of_channel.xyz;
        if channel < surface.colour_outputs {
            by_colours[row * surface.colour_outputs + channel] = FIELD_WEIGHT * by;
        }
        if channel < surface.view_outputs {
            by_views[row * surface.view_outputs + channel] = FIELD_WEIGHT * by;
        }
    }
    let opacity = appearance.opacity.w;
    let by_logit = select(0.0, by_layer.w * opacity * (1.0 - opacity), surface.has_opacity != 0u);
    by_query += by_logit * appearance.opacity.xyz;
    if surface.opacity_outputs > 0u {
        by_logits[row] = FIELD_WEIGHT * by_logit;
    }
    if surface.view_outputs > 3u {
        by_views[row * surface.view_outputs + 3u] = FIELD_WEIGHT * by_logit;
    }
    let first = row * SAMPLE_VALUES;
    by_samples[first] = by_query.x;
    by_samples[first + 1u] = by_query.y;
    by_samples[first + 2u] = by_query.z;
    by_samples[first + 3u] = 0.0;
    by_samples[first + 4u] = 0.0;
}

// Gradients by the control points of the flow and by the place, from those by the query.
@compute @workgroup_size(256)
fn move_samples_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= surface.samples || surface.flow_outputs == 0u {
        return;
    }
    let at = samples[row];
    let first = row * SAMPLE_VALUES;
    var by_place = vec3(moved_samples[first], moved_samples[first + 1u], moved_samples[first + 2u]);
    var by_flow_here = FIELD_WEIGHT * by_place;
    if surface.dimensions == 3u {
        let by = flows_before[row].xyz;
        let unscaled = moved_on_sphere(at.place, by);
        let size = length(unscaled);
        let query = unscaled / size;
        let by_unscaled = (by_place - dot(by_place, query) * query) / size;
        let by_tangent = FIELD_WEIGHT * by_unscaled;
        let along = dot(by_tangent, at.place);
        by_flow_here = by_tangent - along * at.place;
        by_place = by_unscaled - dot(by, at.place) * by_tangent - along * by;
    }
    moved_samples[first] = by_place.x;
    moved_samples[first + 1u] = by_place.y;
    moved_samples[first + 2u] = by_place.z;
    let begin = row * surface.flow_outputs;
    for (var index = 0u; index < surface.flow_outputs; index++) {
        by_flow[begin + index] = 0.0;
    }
    let knots = moments[at.moment];
    for (var index = 0u; index < 4u; index++) {
        let point = begin + knots.knots[index] * surface.dimensions;
        for (var axis = 0u; axis < surface.dimensions; axis++) {
            by_flow[point + axis] += knots.weights[index] * by_flow_here[axis];
        }
    }
}
