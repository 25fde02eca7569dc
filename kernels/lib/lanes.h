#ifndef LIB_LANES_H
#define LIB_LANES_H
/* Lanes: one kernel source for CPUs with wide vectors and for GPUs.
 *
 * A work-item computes LANES neighbouring elements at once, in explicit vector types. LANES is 16 on a CPU, where
 * compilers do not vectorize work-items with data-dependent loops, and 1 on a GPU, whose hardware runs work-items in
 * lanes itself. Masks are ints: comparisons yield 0 for false, and for true 1 (scalars) or -1 (vectors). So masks are
 * combined with &, | and !, never with ~.
 */
#ifndef LANES
#define LANES 1 /* number of lanes of a work-item: 1 or 16 */
#endif
#ifndef COUNTERS
#define COUNTERS 0 /* 1: kernels count their work in `counters`, for benchmarks and tests */
#endif

/* Without AVX-512, compilers warn that the ABI for vectors of 64 bytes differs. This does not matter, as kernels call
 * no functions of other programs. NVIDIA's compiler does not know this warning. */
#if defined(__clang__) && LANES > 1
#pragma clang diagnostic ignored "-Wpsabi"
#endif

/* STRIP: the number of packets (of LANES elements) in a work-item. Starting a work-item takes longer than most
 * packets. */
#if LANES == 16
#include "lib/builtins.h"
#define STRIP 32
#else
#define STRIP 1
#endif

/* INLINED: a function whose arguments and results stay in registers. Other functions get vectors, and on GPUs also
 * structs, in memory. */
#ifndef INLINED /* build options replace it for simulators that need calls */
#define INLINED static inline __attribute__((always_inline))
#endif

/* OUTLINED: a function that is compiled once; PoCL compiles a kernel, with its inlined functions, three times. An
 * OUTLINED function cannot call get_global_id and the like. */
#if LANES == 16
#define OUTLINED static __attribute__((noinline))
#else
#define OUTLINED INLINED
#endif

/* UNROLLED: before a short loop with a constant number of steps, so that an array that the loop indexes stays in
 * registers. ROLLED: before a loop that must not be unrolled, so that its steps share registers. */
#if defined(__clang__) || defined(__NV_CL_C_VERSION)
#define UNROLLED _Pragma("unroll")
#define ROLLED _Pragma("unroll 1")
#else
#define UNROLLED
#define ROLLED
#endif

/* A fence between the shuffles that make a vector and those that read it: otherwise the compiler may replace both by
 * one shuffle for each lane. Clang only respects the fence where arithmetic may be reordered. PoCL 6 would treat an
 * `asm` statement as a call. */
#if defined(__AVX512F__) && defined(__has_builtin)
#if __has_builtin(__arithmetic_fence)
#define ARITHMETIC_FENCE(vector)                                                                               \
    {                                                                                                          \
        _Pragma("clang fp reassociate(on)") vector = __arithmetic_fence(vector);                               \
    }
#endif
#endif
#ifndef ARITHMETIC_FENCE
#define ARITHMETIC_FENCE(vector)
#endif

#define EACH_LANE(F) F(0) F(1) F(2) F(3) F(4) F(5) F(6) F(7) F(8) F(9) F(a) F(b) F(c) F(d) F(e) F(f)

#if LANES == 16
#define WIDE(name) name##16
#elif LANES == 1
#define WIDE(name) name
#else
#error "LANES must be 1 or 16"
#endif
typedef WIDE(float) floatl;
typedef WIDE(int) intl;
typedef WIDE(uint) uintl;
typedef WIDE(long) longl;
#define to_floatl WIDE(convert_float)
#define to_intl WIDE(convert_int)
#define to_longl WIDE(convert_long)
#define to_ucharl WIDE(convert_uchar)
#define as_intl WIDE(as_int)
#define as_floatl WIDE(as_float)
#define as_uintl WIDE(as_uint)

#if LANES == 16
#define load_lanes(p) vload16(0, p)
#define store_lanes(v, p) vstore16(v, 0, p)
#define shifted_lanes(v) (v).s00123456789abcde /* each lane gets its left neighbour's value; the first keeps its own */
#define lane_index ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define gather(p, i)                                                                                           \
    (p)[(i).s0], (p)[(i).s1], (p)[(i).s2], (p)[(i).s3], (p)[(i).s4], (p)[(i).s5], (p)[(i).s6], (p)[(i).s7],    \
        (p)[(i).s8], (p)[(i).s9], (p)[(i).sa], (p)[(i).sb], (p)[(i).sc], (p)[(i).sd], (p)[(i).se], (p)[(i).sf]
/* any() would compile to one branch for each lane. */
#ifdef __has_builtin
#if __has_builtin(__builtin_reduce_or)
#define any_lane(mask) (__builtin_reduce_or((mask) != 0) != 0) /* AVX-512 tests masks directly */
#endif
#endif
#ifndef any_lane
int any_lane(int16 mask)
{
    const int8 half_ = mask.lo | mask.hi;
    const int4 quarter = half_.lo | half_.hi;
    const int2 eighth = quarter.lo | quarter.hi;
    return (eighth.x | eighth.y) != 0;
}
#endif
/* lane_bits: a mask as bits, one for each lane */
#ifdef __has_builtin
#if defined(__AVX512F__) && __has_builtin(__builtin_ia32_cmpd512_mask)
#define lane_bits(mask) (uint)(ushort)__builtin_ia32_cmpd512_mask(mask, (int16)0, 4, (ushort)-1) /* 4: not equal */
#elif __has_builtin(__builtin_reduce_or)
#define lane_bits(mask) (uint)__builtin_reduce_or(((mask) != 0) & ((int16)1 << lane_index))
#endif
#endif
#ifndef lane_bits
uint lane_bits(int16 mask)
{
    const int16 bits = (mask != 0) & ((int16)1 << lane_index);
    const int8 half_ = bits.lo | bits.hi;
    const int4 quarter = half_.lo | half_.hi;
    const int2 eighth = quarter.lo | quarter.hi;
    return (uint)(eighth.x | eighth.y);
}
#endif
float least_lane(float16 v)
{
    const float8 half_ = fmin(v.lo, v.hi);
    const float4 quarter = fmin(half_.lo, half_.hi);
    return fmin(fmin(quarter.x, quarter.y), fmin(quarter.z, quarter.w));
}
/* An access through this struct is one instruction at any address; vload16 and vstore16 of uchar go byte by byte. */
typedef struct __attribute__((packed)) {
    uchar16 bytes;
} UnalignedBytes;
#define store_bytes(v, p) (((global UnalignedBytes *)(p))->bytes = (v))
#define load_bytes(p) to_intl(((global const UnalignedBytes *)(p))->bytes)
#else
#define load_bytes(p) to_intl(*(p))
#define store_bytes(v, p) (*(p) = (v))
#define load_lanes(p) (*(p))
#define store_lanes(v, p) (*(p) = (v))
#define shifted_lanes(v) (v)
#define lane_index 0
#define any_lane(mask) ((mask) != 0)
#define lane_bits(mask) ((mask) != 0 ? 1u : 0u)
#define least_lane(v) (v)
#define gather(p, i) (p)[i]
#endif

#define LOWEST(bits) (63 - (int)clz((ulong)(bits) & -(ulong)(bits))) /* index of the lowest set bit */
#define WITHOUT_LOWEST(bits) (LANES == 1 ? 0 : (bits) & ((bits) - 1)) /* clears the lowest set bit of lane_bits */

/* CHOSEN: one of at most four values. On GPUs conditions choose the value, since an array that is indexed at run time
 * cannot be in registers. */
#if LANES == 1
#define CHOSEN(values, i) ((i) < 2 ? (i) ? (values)[1] : (values)[0] : (i) == 2 ? (values)[2] : (values)[3])
#else
#define CHOSEN(values, i) (values)[i]
#endif

/* Read or set one lane of a variable. On a GPU, there is one lane, and the variable's address is not taken. */
#if LANES == 1
#define float_lane(v, lane) (v)
#define int_lane(v, lane) (v)
#define set_float_lane(v, lane, value) ((v) = (value))
#define set_int_lane(v, lane, value) ((v) = (value))
#else
#define float_lane(v, lane) (((const float *)&(v))[lane])
#define int_lane(v, lane) (((const int *)&(v))[lane])
#define set_float_lane(v, lane, value) (((float *)&(v))[lane] = (value))
#define set_int_lane(v, lane, value) (((int *)&(v))[lane] = (value))
#endif

/* Load or store only the first `count` lanes, at the end of a row. Other lanes are loaded as `beyond`. */
INLINED floatl load_first(global const float *from, int count, float beyond)
{
    floatl v = beyond;
    if (count >= LANES)
        return load_lanes(from);
    for (int lane = 0; lane < count; lane++)
        set_float_lane(v, lane, from[lane]);
    return v;
}
INLINED intl load_first_bytes(global const uchar *from, int count, int beyond)
{
    intl v = beyond;
    if (count >= LANES)
        return load_bytes(from);
    for (int lane = 0; lane < count; lane++)
        set_int_lane(v, lane, from[lane]);
    return v;
}
INLINED void store_first(floatl v, global float *to, int count)
{
    if (count >= LANES)
        store_lanes(v, to);
    else
        for (int lane = 0; lane < count; lane++)
            to[lane] = float_lane(v, lane);
}
INLINED void store_first_bytes(intl v, global uchar *to, int count)
{
    if (count >= LANES)
        store_bytes(to_ucharl(v), to);
    else
        for (int lane = 0; lane < count; lane++)
            to[lane] = int_lane(v, lane);
}

/* Writes the lanes whose bit is set, one after the other, without gaps. */
#if defined(__AVX512F__) && defined(__has_builtin)
#if __has_builtin(__builtin_ia32_compresssf512_mask)
INLINED void compress_lanes(float16 v, uint bits, global float *to)
{
    const float16 first = __builtin_ia32_compresssf512_mask(v, v, (ushort)bits);
    __builtin_ia32_storeups512_mask((float *)(uintptr_t)to, first, (ushort)((1u << popcount(bits)) - 1));
}
#define store_some compress_lanes
#endif
#endif
#ifndef store_some
INLINED void store_some(floatl v, uint bits, global float *to)
{
    for (; bits; bits = WITHOUT_LOWEST(bits))
        *to++ = float_lane(v, LOWEST(bits));
}
#endif

/* With COUNTERS: a kernel's parameter, the argument to pass, and code that adds a mask's number of true lanes to a
 * counter. */
#if COUNTERS
#define COUNTERS_PARAMETER(type) , global type *counters
#define COUNTERS_ARGUMENT(type) counters
#define COUNT(counter, mask)                                                                                   \
    for (int lane = 0; lane < LANES; lane++)                                                                   \
        counter += int_lane(mask, lane) != 0;
#else
#define COUNTERS_PARAMETER(type)
#define COUNTERS_ARGUMENT(type) (global type *)0
#define COUNT(counter, mask)
#endif

/* Selects floats or ints lane by lane. OpenCL's select() is a call on some runtimes. */
#define select_lanes(mask, yes, no) ((mask) ? (yes) : (no))

#if LANES == 16
#define ZIP_LOW(a, b)                                                                                          \
    (float16)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3, a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7)
#define ZIP_HIGH(a, b)                                                                                         \
    (float16)(a.s8, b.s8, a.s9, b.s9, a.sa, b.sa, a.sb, b.sb, a.sc, b.sc, a.sd, b.sd, a.se, b.se, a.sf, b.sf)
/* Transposes 16 rows of 16 values: four times, each of the first 8 rows is interleaved with the row 8 further on. */
INLINED void transpose(float16 *rows)
{
    float16 zipped[16];
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 8; i++) {
            zipped[2 * i] = ZIP_LOW(rows[i], rows[i + 8]);
            zipped[2 * i + 1] = ZIP_HIGH(rows[i], rows[i + 8]);
        }
        for (int i = 0; i < 8; i++) {
            rows[2 * i] = ZIP_LOW(zipped[i], zipped[i + 8]);
            rows[2 * i + 1] = ZIP_HIGH(zipped[i], zipped[i + 8]);
        }
    }
}
#endif

#if LANES == 16
/* An access through this struct is one instruction at any address; vload2 and vload4 load value by value. */
typedef struct __attribute__((packed)) {
    float2 values;
} UnalignedPair;
typedef struct __attribute__((packed)) {
    float4 values;
} UnalignedFour;
#define PAIR_AT(array, l) (((global const UnalignedPair *)((array) + at.s##l))->values)

#define ZIP_FIRST(a, b)                                                                                        \
    (float16)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5, a.s8, b.s8, a.s9, b.s9, a.sc, b.sc, a.sd, b.sd)
#define ZIP_LAST(a, b)                                                                                         \
    (float16)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7, a.sa, b.sa, a.sb, b.sb, a.se, b.se, a.sf, b.sf)

/* Gathers a row of 4 floats for each lane, as 4 vectors. Whole rows are read and interleaved, which is faster than 4
 * gathers. */
INLINED void gather_rows(global const float *rows, int16 at, float16 *columns)
{
    global const UnalignedFour *all = (global const UnalignedFour *)rows;
#define FOUR_ROWS(a, b, c, d) (float16)(all[at.a].values, all[at.b].values, all[at.c].values, all[at.d].values)
    float16 a = FOUR_ROWS(s0, s4, s8, sc), b = FOUR_ROWS(s1, s5, s9, sd);
    float16 c = FOUR_ROWS(s2, s6, sa, se), d = FOUR_ROWS(s3, s7, sb, sf);
    ARITHMETIC_FENCE(a)
    ARITHMETIC_FENCE(b)
    ARITHMETIC_FENCE(c)
    ARITHMETIC_FENCE(d)
    float16 ac_first = ZIP_FIRST(a, c), bd_first = ZIP_FIRST(b, d), ac_last = ZIP_LAST(a, c), bd_last = ZIP_LAST(b, d);
    ARITHMETIC_FENCE(ac_first)
    ARITHMETIC_FENCE(bd_first)
    ARITHMETIC_FENCE(ac_last)
    ARITHMETIC_FENCE(bd_last)
    columns[0] = ZIP_FIRST(ac_first, bd_first);
    columns[1] = ZIP_LAST(ac_first, bd_first);
    columns[2] = ZIP_FIRST(ac_last, bd_last);
    columns[3] = ZIP_LAST(ac_last, bd_last);
}

/* Gathers a value and the next one for each lane, with a single load. */
INLINED void gather_pairs(global const float *values, int16 at, float16 *first, float16 *second)
{
    const float16 low = (float16)(PAIR_AT(values, 0), PAIR_AT(values, 1), PAIR_AT(values, 2), PAIR_AT(values, 3),
                                  PAIR_AT(values, 4), PAIR_AT(values, 5), PAIR_AT(values, 6), PAIR_AT(values, 7));
    const float16 high = (float16)(PAIR_AT(values, 8), PAIR_AT(values, 9), PAIR_AT(values, a), PAIR_AT(values, b),
                                   PAIR_AT(values, c), PAIR_AT(values, d), PAIR_AT(values, e), PAIR_AT(values, f));
    *first = (float16)(low.even, high.even);
    *second = (float16)(low.odd, high.odd);
}

#else
INLINED void gather_rows(global const float *rows, int at, float *columns)
{
    const float4 row = vload4(at, rows);
    columns[0] = row.x;
    columns[1] = row.y;
    columns[2] = row.z;
    columns[3] = row.w;
}

INLINED void gather_pairs(global const float *values, int at, float *first, float *second)
{
    *first = values[at];
    *second = values[at + 1];
}
#endif

/* Stores two values for each lane, side by side. */
#if LANES == 16
INLINED void store_pairs(float16 first, float16 second, global float *pairs)
{
    store_lanes(ZIP_LOW(first, second), pairs);
    store_lanes(ZIP_HIGH(first, second), pairs + LANES);
}
#else
INLINED void store_pairs(float first, float second, global float *pairs)
{
    pairs[0] = first;
    pairs[1] = second;
}
#endif

/* Gathers 2 x 2 values for each lane: a value and the next one, and the two values `below` elements after these. */
INLINED void gather_cells(global const float *values, int below, intl at, floatl *corners)
{
    gather_pairs(values, at, &corners[0], &corners[1]);
    gather_pairs(values + below, at, &corners[2], &corners[3]);
}

/* For |x| < 2^31, floor_lanes and ceil_lanes take 4 instructions; floor() and ceil() of vectors take 14. For x >= 0,
 * truncated() equals floor_lanes, and takes 2 instructions. */
#if LANES == 16
#define truncated(x) to_floatl(to_intl(x))
floatl floor_lanes(floatl x)
{
    const floatl whole = truncated(x);
    return whole - select_lanes(whole > x, (floatl)1.0f, (floatl)0.0f);
}
#else
#define truncated floor
#define floor_lanes floor
#endif
#define ceil_lanes(x) (-floor_lanes(-(x)))

/* These take one instruction each; fmin and fmax take four. If a is NaN, the result is b. */
#define min_lanes(a, b) select_lanes((a) < (b), a, b)
#define max_lanes(a, b) select_lanes((a) > (b), a, b)

/* NaN becomes `low`, so that the result can be converted to an index: conversions outside of an int's range are
 * undefined. */
#define clamp_lanes(x, low, high) min_lanes(max_lanes(x, low), high)

/* isfinite() would compile to one call for each lane. */
#define isfinite_lanes(v) (fabs(v) < INFINITY)

/* prefetch_at(p): prefetches the data at address p. */
#if LANES == 16 && defined(__has_builtin)
#if __has_builtin(__builtin_prefetch)
#define prefetch_at(p) __builtin_prefetch((const void *)(uintptr_t)(p))
#endif
#endif
#ifndef prefetch_at
#define prefetch_at(p)
#endif
#endif
