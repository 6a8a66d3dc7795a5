// Temporal parameters of a table at a moment, one thread per Gaussian: Omni4DGS Eqs. 1 to 3, PVG.
//
// Times are frames. The host removes whole cycles from a moment in f64; here they are removed from peak times
// in two exact steps. The angle thus stays exact after thousands of cycles between peak and moment.

// Offset of an array that the model lacks.
const NONE: u32 = 0xffffffffu;
// Lifespan of a constant opacity: dividing by it gives zero.
const ENDLESS: f32 = 3.4e38;

const VELOCITY_NONE: u32 = 0u;
const VELOCITY_FREE: u32 = 1u;
const VELOCITY_LITERAL: u32 = 2u;
const VELOCITY_PROJECTED: u32 = 3u;

struct TemporalView {
    // Three moments, each as a frame rounded to f32, the remainder, and the phase in cycles, -1/2 to 1/2.
    moments: array<vec4<f32>, 3>,
    // Observer of decomposed velocities: position, and direction from zenith to nadir.
    observer: vec3<f32>,
    // Frames by which the state is moved on (temporal smoothing).
    shift: f32,
    down: vec3<f32>,
    // Number of Gaussians; index of the first among all activated ones, and among those drawn alone.
    len: u32,
    first: u32,
    first_alone: u32,
    // Feature channels of all activated Gaussians.
    channels: u32,
    // Offset of each array in the table, in values; NONE if it is missing.
    positions: u32,
    opacity_logits: u32,
    peaks: u32,
    log_lifespans: u32,
    // The free velocities, or the radial ones.
    velocities: u32,
    tangential_velocities: u32,
    velocity_model: u32,
    // Exponent of the cosine of the latitude.
    gamma: f32,
    // The cycle in frames; its upper 12 bits of mantissa, and the rest.
    cycle: f32,
    cycle_high: f32,
    cycle_low: f32,
    // Logarithms of the bounds of lifespans.
    log_least: f32,
    log_largest: f32,
    // Share of the peak opacity at or below which a Gaussian is not drawn.
    least_marginal: f32,
    // theta_dgm: Gaussians with a smaller staticness are dynamic.
    dynamic_below: f32,
    // Units of the feature channels; 0 for a channel that is not rendered.
    velocity_unit: f32,
    lifespan_unit: f32,
    // Upper bound of rendered lifespans, frames.
    lifespan_largest: f32,
}

// Moment of the drawn state: the image's time minus the shift.
const DRAWN: u32 = 0u;
// The image's time, and one frame later.
const IMAGE: u32 = 1u;
const NEXT: u32 = 2u;

@group(0) @binding(0) var<uniform> temporal: TemporalView;
@group(0) @binding(1) var<storage, read> values: array<f32>;

fn table_vector(first: u32, index: u32) -> vec3<f32> {
    let at = first + index * 3u;
    return vec3(values[at], values[at + 1u], values[at + 2u]);
}

fn peak_of(index: u32) -> f32 {
    if temporal.peaks == NONE {
        return 0.0;
    }
    return values[temporal.peaks + index];
}

fn lifespan_of(index: u32) -> f32 {
    if temporal.log_lifespans == NONE {
        return ENDLESS;
    }
    let raw = values[temporal.log_lifespans + index];
    // A clamp may turn NaN into a number.
    return select(
        exp(clamp(raw, temporal.log_least, temporal.log_largest)),
        raw,
        is_nan(raw),
    );
}

// rho = beta / l
fn staticness_of(lifespan: f32) -> f32 {
    return lifespan / temporal.cycle;
}

fn is_dynamic(index: u32) -> bool {
    return staticness_of(lifespan_of(index)) < temporal.dynamic_below;
}

// Weights of the radial and the tangential velocity (3), and the direction at which they hold.
struct VelocityWeights {
    direction: vec3<f32>,
    radial: f32,
    tangential: f32,
}

fn velocity_weights(index: u32) -> VelocityWeights {
    let offset = table_vector(temporal.positions, index) - temporal.observer;
    let distance = length(offset);
    var direction = vec3<f32>();
    var cosine = 1.0;
    if distance > LEAST_DISTANCE {
        direction = offset / distance;
        // `sqrt(1 - y^2)` would cancel near the poles.
        cosine = length(cross(direction, temporal.down));
    }
    let tangential = pow(clamp(cosine, LEAST_COSINE, 1.0), temporal.gamma);
    return VelocityWeights(direction, 1.0 - tangential, tangential);
}

fn velocity_of(index: u32) -> vec3<f32> {
    if temporal.velocity_model == VELOCITY_NONE {
        return vec3<f32>();
    }
    let first = table_vector(temporal.velocities, index);
    if temporal.velocity_model == VELOCITY_FREE {
        return first;
    }
    let second = table_vector(temporal.tangential_velocities, index);
    let weights = velocity_weights(index);
    if temporal.velocity_model == VELOCITY_LITERAL {
        return first * weights.radial + second * weights.tangential;
    }
    return weights.direction * dot(weights.direction, first - second) + second;
}

// Frames from the peak to a moment, exact to the last bit.
fn distance_from_peak(moment: u32, peak: f32) -> f32 {
    return (temporal.moments[moment].x - peak) + temporal.moments[moment].y;
}

// l/(2 pi) sin(2 pi d / l) and its derivative at a moment.
fn vibration(moment: u32, peak: f32) -> vec2<f32> {
    var turns = distance_from_peak(moment, peak) / temporal.cycle;
    if abs(turns) > 0.5 {
        let cycles = round(peak / temporal.cycle);
        let rest = (peak - cycles * temporal.cycle_high) - cycles * temporal.cycle_low;
        turns = temporal.moments[moment].z - rest / temporal.cycle;
    }
    let sine_cosine = sin_cos(TAU * (turns - round(turns)));
    return vec2(temporal.cycle / TAU * sine_cosine.x, sine_cosine.y);
}

// The temporal parameters of one Gaussian.
struct TemporalParameters {
    peak: f32,
    lifespan: f32,
    velocity: vec3<f32>,
}

fn parameters_of(index: u32) -> TemporalParameters {
    return TemporalParameters(peak_of(index), lifespan_of(index), velocity_of(index));
}

// m = exp(-(d/beta)^2 / 2)
fn marginal_of(parameters: TemporalParameters) -> f32 {
    let ratio = distance_from_peak(DRAWN, parameters.peak) / parameters.lifespan;
    return exp(-0.5 * ratio * ratio);
}

fn drawn_marginal(marginal: f32) -> f32 {
    return select(0.0, marginal, marginal > temporal.least_marginal);
}

// exp(-rho/2)
fn steadiness_of(lifespan: f32) -> f32 {
    return exp(-0.5 * staticness_of(lifespan));
}

// Gradients by the activated parameters of one Gaussian.
struct TemporalGradient {
    peak: f32,
    log_lifespan: f32,
    velocity: vec3<f32>,
}

// Adds gradients by activated parameters to those by the raw ones.
fn raw_vjp(index: u32, by: TemporalGradient) -> RawTemporalGradient {
    var raw = RawTemporalGradient(by.peak, 0.0, vec3<f32>(), vec3<f32>());
    if temporal.log_lifespans != NONE {
        let value = values[temporal.log_lifespans + index];
        if value >= temporal.log_least && value <= temporal.log_largest {
            raw.log_lifespan = by.log_lifespan;
        }
    }
    if temporal.velocity_model == VELOCITY_FREE {
        raw.velocity = by.velocity;
    } else if temporal.velocity_model != VELOCITY_NONE {
        let weights = velocity_weights(index);
        var along = by.velocity;
        var across = by.velocity;
        if temporal.velocity_model == VELOCITY_PROJECTED {
            along = weights.direction * dot(weights.direction, by.velocity);
            across = by.velocity - along;
        }
        // Below this weight, Adam would amplify rounding to full steps.
        if weights.radial >= LEAST_WEIGHT {
            raw.velocity = along * weights.radial;
        }
        if weights.tangential >= LEAST_WEIGHT {
            raw.tangential_velocity = across * weights.tangential;
        }
    }
    return raw;
}

// Gradients by the raw parameters of one Gaussian.
struct RawTemporalGradient {
    peak: f32,
    log_lifespan: f32,
    // Gradient by the free velocity, or by the radial one.
    velocity: vec3<f32>,
    tangential_velocity: vec3<f32>,
}
