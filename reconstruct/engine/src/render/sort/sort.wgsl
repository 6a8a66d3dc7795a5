// Stable radix sort of (key, item) pairs, eight bits and three kernels per pass.
//
// A pass counts the digits of every block, sums the counts of each digit block by block, and moves every pair
// to its place. The place depends on the pairs of the same digit that come before it in its block. To count
// them, a workgroup sorts the digits of the block, first by their low and then by their high four bits. Each
// thread counts its consecutive pairs in order, so that equal digits keep theirs.

const PAIRS_PER_THREAD: u32 = 4u;
const BLOCK: u32 = WORKGROUP * PAIRS_PER_THREAD;
const DIGITS: u32 = 256u;
// Counters per thread for half a digit. Two 16-bit counters share a word: values 0 to 7 in the low half, 8 to
// 15 in the high half.
const COUNTER_ROWS: u32 = 8u;

struct SortPass {
    // Lowest bit of the digit in the key.
    shift: u32,
    // Capacity of the buffers in pairs.
    capacity: u32,
}

@group(0) @binding(0) var<uniform> sort_pass: SortPass;
// Number of pairs; those beyond the capacity are ignored.
@group(0) @binding(1) var<storage, read> count: array<u32>;
// Counts by digit, then by block; after `sum_digits`, the number of earlier pairs of the digit.
@group(0) @binding(2) var<storage, read_write> places: array<u32>;
@group(0) @binding(3) var<storage, read> keys_in: array<u32>;
@group(0) @binding(4) var<storage, read> items_in: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> items_out: array<u32>;

@group(0) @binding(3) var<storage, read_write> digit_totals: array<u32>;

@group(0) @binding(7) var<storage, read> all_digit_totals: array<u32>;

var<workgroup> digit_counts: array<atomic<u32>, DIGITS>;
// Digits of a block with the pairs' indices in it: digit << 16 | index.
var<workgroup> numbered: array<u32, BLOCK>;
// [half digit & 7][thread]
var<workgroup> counters: array<u32, COUNTER_ROWS * WORKGROUP>;
var<workgroup> sums: array<u32, WORKGROUP>;
// Offset from an index in the sorted block to that among all pairs, by digit.
var<workgroup> digit_offsets: array<u32, DIGITS>;

fn pair_count() -> u32 {
    return min(count[0], sort_pass.capacity);
}

fn block_count() -> u32 {
    return (pair_count() + BLOCK - 1u) / BLOCK;
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
    atomicStore(&digit_counts[thread], 0u);
    workgroupBarrier();
    let pairs = pair_count();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let pair = block * BLOCK + i * WORKGROUP + thread;
        if pair < pairs {
            atomicAdd(&digit_counts[digit_of(keys_in[pair])], 1u);
        }
    }
    workgroupBarrier();
    if block < block_count() {
        places[thread * block_count() + block] = atomicLoad(&digit_counts[thread]);
    }
}

// Replaces the threads' numbers in `sums` by their inclusive prefix sums.
fn sum_up(thread: u32) {
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
}

// One workgroup per digit.
@compute @workgroup_size(256)
fn sum_digits(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let digit = group.x;
    let blocks = block_count();
    var before = 0u;
    for (var first = 0u; first < blocks; first += BLOCK) {
        let mine = first + thread * PAIRS_PER_THREAD;
        var sum = 0u;
        for (var i = mine; i < min(mine + PAIRS_PER_THREAD, blocks); i++) {
            sum += places[digit * blocks + i];
        }
        sums[thread] = sum;
        sum_up(thread);
        var place = before + sums[thread] - sum;
        before += sums[WORKGROUP - 1u];
        for (var i = mine; i < min(mine + PAIRS_PER_THREAD, blocks); i++) {
            let counted = places[digit * blocks + i];
            places[digit * blocks + i] = place;
            place += counted;
        }
        workgroupBarrier();
    }
    if thread == 0u {
        digit_totals[digit] = before;
    }
}

// Sorts the numbered digits of a block by four of their bits.
fn sort_by(thread: u32, shift: u32) {
    var mine: array<u32, PAIRS_PER_THREAD>;
    for (var row = 0u; row < COUNTER_ROWS; row++) {
        counters[row * WORKGROUP + thread] = 0u;
    }
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        mine[i] = numbered[thread * PAIRS_PER_THREAD + i];
        let half = (mine[i] >> shift) & 15u;
        counters[(half & 7u) * WORKGROUP + thread] += 1u << (16u * (half >> 3u));
    }
    workgroupBarrier();
    // Scan all counters, value by value and thread by thread.
    var sum = 0u;
    for (var i = 0u; i < COUNTER_ROWS; i++) {
        sum += counters[thread * COUNTER_ROWS + i];
    }
    sums[thread] = sum;
    sum_up(thread);
    // Values of the high halves come after all of the low halves.
    var before = sums[thread] - sum + (sums[WORKGROUP - 1u] << 16u);
    for (var i = 0u; i < COUNTER_ROWS; i++) {
        let counter = thread * COUNTER_ROWS + i;
        let value = counters[counter];
        counters[counter] = before;
        before += value;
    }
    workgroupBarrier();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let half = (mine[i] >> shift) & 15u;
        let counter = (half & 7u) * WORKGROUP + thread;
        let place = (counters[counter] >> (16u * (half >> 3u))) & 0xffffu;
        counters[counter] += 1u << (16u * (half >> 3u));
        numbered[place] = mine[i];
    }
    workgroupBarrier();
}

@compute @workgroup_size(256)
fn move_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = workgroup_number(group, groups);
    let pairs = pair_count();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let number = thread * PAIRS_PER_THREAD + i;
        let pair = block * BLOCK + number;
        // Missing pairs stay last: no digit is larger, and none comes later.
        var digit = DIGITS - 1u;
        if pair < pairs {
            digit = digit_of(keys_in[pair]);
        }
        numbered[number] = digit << 16u | number;
    }
    workgroupBarrier();
    sort_by(thread, 16u);
    sort_by(thread, 20u);
    let total = all_digit_totals[thread];
    sums[thread] = total;
    sum_up(thread);
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let place = i * WORKGROUP + thread;
        let digit = numbered[place] >> 16u;
        if block < block_count() && (place == 0u || numbered[place - 1u] >> 16u != digit) {
            let first = sums[digit] - all_digit_totals[digit];
            digit_offsets[digit] = first + places[digit * block_count() + block] - place;
        }
    }
    workgroupBarrier();
    for (var i = 0u; i < PAIRS_PER_THREAD; i++) {
        let place = i * WORKGROUP + thread;
        let digit = numbered[place] >> 16u;
        let pair = block * BLOCK + (numbered[place] & 0xffffu);
        if pair < pairs {
            let to = digit_offsets[digit] + place;
            keys_out[to] = keys_in[pair];
            items_out[to] = items_in[pair];
        }
    }
}
