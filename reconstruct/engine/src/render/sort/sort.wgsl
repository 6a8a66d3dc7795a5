// A stable radix sort of (key, item) pairs, four bits a pass.
//
// A pass counts the digits of every block, sums the counts digit by digit and block by block
// (scan.wgsl), and moves every pair to its place. A thread owns consecutive pairs and walks them in
// order, so pairs of equal digits keep theirs.

const PAIRS_PER_THREAD: u32 = 8u;
const BLOCK: u32 = WORKGROUP * PAIRS_PER_THREAD;
const DIGITS: u32 = 16u;
// Two 16-bit counters share a word: digits 0 to 7 the low half, 8 to 15 the high half.
const COUNTER_ROWS: u32 = 8u;

struct SortPass {
    // Where the digit begins in the key.
    shift: u32,
    // Pairs that the buffers hold.
    capacity: u32,
    // Blocks of the whole capacity.
    blocks: u32,
}

@group(0) @binding(0) var<uniform> sort_pass: SortPass;
// Number of pairs; those beyond the capacity do not exist.
@group(0) @binding(1) var<storage, read> count: array<u32>;
@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
// By digit, then by block: how many, and after the scan where to.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read> items_in: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> items_out: array<u32>;

var<workgroup> digit_counts: array<atomic<u32>, DIGITS>;
// [digit & 7][thread]
var<workgroup> counters: array<u32, COUNTER_ROWS * WORKGROUP>;
var<workgroup> sums: array<u32, WORKGROUP>;

fn pair_count() -> u32 {
    return min(count[0], sort_pass.capacity);
}

fn digit_of(key: u32) -> u32 {
    return (key >> sort_pass.shift) & (DIGITS - 1u);
}

@compute @workgroup_size(256)
fn count_digits(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = workgroup_number(group, groups);
    if thread < DIGITS {
        atomicStore(&digit_counts[thread], 0u);
    }
    workgroupBarrier();
    let pairs = pair_count();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let pair = block * BLOCK + i * WORKGROUP + thread;
        if pair < pairs {
            atomicAdd(&digit_counts[digit_of(keys_in[pair])], 1u);
        }
    }
    workgroupBarrier();
    if thread < DIGITS && block < sort_pass.blocks {
        places[thread * sort_pass.blocks + block] = atomicLoad(&digit_counts[thread]);
    }
}

@compute @workgroup_size(256)
fn move_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = workgroup_number(group, groups);
    let pairs = pair_count();
    let first = block * BLOCK + thread * PAIRS_PER_THREAD;
    // Count the digits of this thread's pairs.
    for (var row = 0u; row < COUNTER_ROWS; row++) {
        counters[row * WORKGROUP + thread] = 0u;
    }
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        if first + i < pairs {
            let digit = digit_of(keys_in[first + i]);
            counters[(digit & 7u) * WORKGROUP + thread] += 1u << (16u * (digit >> 3u));
        }
    }
    workgroupBarrier();
    // Scan all counters, digit by digit and thread by thread.
    var sum = 0u;
    for (var i = 0u; i < COUNTER_ROWS; i++) {
        sum += counters[thread * COUNTER_ROWS + i];
    }
    sums[thread] = sum;
    workgroupBarrier();
    for (var distance = 1u; distance < WORKGROUP; distance *= 2u) {
        var left = 0u;
        if thread >= distance {
            left = sums[thread - distance];
        }
        workgroupBarrier();
        sums[thread] += left;
        workgroupBarrier();
    }
    // Digits of the high halves come after all of the low halves.
    var before = sums[thread] - sum + (sums[WORKGROUP - 1u] << 16u);
    for (var i = 0u; i < COUNTER_ROWS; i++) {
        let counter = thread * COUNTER_ROWS + i;
        let value = counters[counter];
        counters[counter] = before;
        before += value;
    }
    workgroupBarrier();
    var digit_starts: array<u32, DIGITS>;
    for (var digit = 0u; digit < DIGITS; digit++) {
        digit_starts[digit] = (counters[(digit & 7u) * WORKGROUP] >> (16u * (digit >> 3u))) & 0xffffu;
    }
    workgroupBarrier();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        if first + i < pairs {
            let key = keys_in[first + i];
            let digit = digit_of(key);
            let half = 16u * (digit >> 3u);
            let counter = (digit & 7u) * WORKGROUP + thread;
            let rank = ((counters[counter] >> half) & 0xffffu) - digit_starts[digit];
            counters[counter] += 1u << half;
            let place = places[digit * sort_pass.blocks + block] + rank;
            keys_out[place] = key;
            items_out[place] = items_in[first + i];
        }
    }
}
