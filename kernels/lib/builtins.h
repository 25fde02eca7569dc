#ifndef LIB_BUILTINS_H
#define LIB_BUILTINS_H
/* Inlined versions of OpenCL's built-in functions, for inner loops. Results equal the built-in functions' to the bit.
 *
 * PoCL 6 compiles the built-ins to calls (CONTRIBUTING.md shows why). All registers are saved around a call, which
 * doubles the time. The versions below use comparisons, bit operations and packed structs: one or two instructions with
 * any compiler. Only Clang supports C functions with one name for several types; with other compilers, or if LANES is
 * 1, the built-ins are used.
 */
#ifdef __clang__

#define OVERLOADED static inline __attribute__((overloadable, always_inline))

/* If one argument of fmin or fmax is NaN, the result is the other argument. */
#define INLINED_OF_FLOATS(type, bits)                                                                          \
    OVERLOADED type inlined_fabs(type x)                                                                       \
    {                                                                                                          \
        return as_##type(as_##bits(x) & 0x7FFFFFFF);                                                           \
    }                                                                                                          \
    OVERLOADED type inlined_fmin(type a, type b)                                                               \
    {                                                                                                          \
        return ((a < b) | (b != b)) ? a : b;                                                                   \
    }                                                                                                          \
    OVERLOADED type inlined_fmax(type a, type b)                                                               \
    {                                                                                                          \
        return ((a > b) | (b != b)) ? a : b;                                                                   \
    }
INLINED_OF_FLOATS(float, int)
INLINED_OF_FLOATS(float2, int2)
INLINED_OF_FLOATS(float3, int3)
INLINED_OF_FLOATS(float4, int4)
INLINED_OF_FLOATS(float8, int8)
INLINED_OF_FLOATS(float16, int16)

/* If a is NaN, the result is b, so clamp(NaN, low, high) is low (which OpenCL does not guarantee). */
#define INLINED_OF_ALL(type)                                                                                   \
    OVERLOADED type inlined_min(type a, type b)                                                                \
    {                                                                                                          \
        return a < b ? a : b;                                                                                  \
    }                                                                                                          \
    OVERLOADED type inlined_max(type a, type b)                                                                \
    {                                                                                                          \
        return a > b ? a : b;                                                                                  \
    }
INLINED_OF_ALL(float)
INLINED_OF_ALL(float2)
INLINED_OF_ALL(float3)
INLINED_OF_ALL(float4)
INLINED_OF_ALL(float8)
INLINED_OF_ALL(float16)
INLINED_OF_ALL(int)
INLINED_OF_ALL(int2)
INLINED_OF_ALL(int4)
INLINED_OF_ALL(int16)
INLINED_OF_ALL(uint)
INLINED_OF_ALL(uint16)
INLINED_OF_ALL(long)
INLINED_OF_ALL(long16)
INLINED_OF_ALL(ulong)

/* The second argument of vector functions may be a scalar. */
#define WITH_NUMBER(name, type, number)                                                                        \
    OVERLOADED type name(type a, number b)                                                                     \
    {                                                                                                          \
        return name(a, (type)b);                                                                               \
    }
#define WITH_NUMBERS(type, number) WITH_NUMBER(inlined_min, type, number) WITH_NUMBER(inlined_max, type, number)
#define WITH_FLOATS(type)                                                                                      \
    WITH_NUMBERS(type, float)                                                                                  \
    WITH_NUMBER(inlined_fmin, type, float)                                                                     \
    WITH_NUMBER(inlined_fmax, type, float)
WITH_FLOATS(float2)
WITH_FLOATS(float3)
WITH_FLOATS(float4)
WITH_FLOATS(float8)
WITH_FLOATS(float16)
WITH_NUMBERS(int2, int)
WITH_NUMBERS(int4, int)
WITH_NUMBERS(int16, int)

/* Loads and stores at any address, in one instruction */
#define LOADED_AND_STORED(space, type, count)                                                                  \
    typedef struct __attribute__((packed)) {                                                                   \
        type##count values;                                                                                    \
    } space##_##type##count;                                                                                   \
    OVERLOADED type##count inlined_vload##count(size_t number, space const type *p)                            \
    {                                                                                                          \
        return ((space const space##_##type##count *)p)[number].values;                                        \
    }                                                                                                          \
    OVERLOADED void inlined_vstore##count(type##count values, size_t number, space type *p)                    \
    {                                                                                                          \
        ((space space##_##type##count *)p)[number].values = values;                                            \
    }
LOADED_AND_STORED(global, float, 2)
LOADED_AND_STORED(global, float, 4)
LOADED_AND_STORED(global, float, 8)
LOADED_AND_STORED(global, float, 16)
LOADED_AND_STORED(global, ushort, 4)
LOADED_AND_STORED(global, int, 16)
LOADED_AND_STORED(global, uint, 16)
LOADED_AND_STORED(private, float, 16)
LOADED_AND_STORED(private, int, 16)

/* A struct of a 3-vector has the size of a 4-vector, so components are accessed one by one. */
#define THREE_LOADED_AND_STORED(type)                                                                          \
    OVERLOADED type##3 inlined_vload3(size_t number, global const type *p)                                     \
    {                                                                                                          \
        return (type##3)(p[3 * number], p[3 * number + 1], p[3 * number + 2]);                                 \
    }                                                                                                          \
    OVERLOADED void inlined_vstore3(type##3 values, size_t number, global type *p)                             \
    {                                                                                                          \
        p[3 * number] = values.x;                                                                              \
        p[3 * number + 1] = values.y;                                                                          \
        p[3 * number + 2] = values.z;                                                                          \
    }
THREE_LOADED_AND_STORED(float)
THREE_LOADED_AND_STORED(uchar)

/* Runtimes may define these names as macros, so they are undefined first. */
#undef fabs
#undef fmin
#undef fmax
#undef min
#undef max
#undef clamp
#undef isnan
#undef vload2
#undef vload3
#undef vload4
#undef vload8
#undef vload16
#undef vstore2
#undef vstore3
#undef vstore4
#undef vstore8
#undef vstore16
#define fabs inlined_fabs
#define fmin inlined_fmin
#define fmax inlined_fmax
#define min inlined_min
#define max inlined_max
#define clamp(x, low, high) min(max(x, low), high)
#define isnan(x) ((x) != (x))
#define vload2 inlined_vload2
#define vload3 inlined_vload3
#define vload4 inlined_vload4
#define vload8 inlined_vload8
#define vload16 inlined_vload16
#define vstore2 inlined_vstore2
#define vstore3 inlined_vstore3
#define vstore4 inlined_vstore4
#define vstore8 inlined_vstore8
#define vstore16 inlined_vstore16
#ifdef __has_builtin
#if __has_builtin(__builtin_elementwise_floor)
#undef floor
#define floor __builtin_elementwise_floor
#endif
#if __has_builtin(__builtin_elementwise_ceil)
#undef ceil
#define ceil __builtin_elementwise_ceil
#endif
#if __has_builtin(__builtin_elementwise_sqrt)
#undef sqrt
#define sqrt __builtin_elementwise_sqrt
#endif
#endif

#endif
#endif
