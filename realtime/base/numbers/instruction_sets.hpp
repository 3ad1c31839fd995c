#pragma once

// For a table of loops that fathom_kernels (recon/CMakeLists.txt) compiles once per instruction set:
// baseline##Name() runs on every processor, fastest##Name() is the fastest set that this processor has. The
// loops define `Type table()` in the namespace of their set. All sets give the same bits.
#define FATHOM_INSTRUCTION_SETS(Type, Name)    \
  namespace baseline {                         \
  Type table();                                \
  }                                            \
  namespace avx2 {                             \
  Type table();                                \
  }                                            \
  [[nodiscard]] inline Type baseline##Name() { \
    return baseline::table();                  \
  }                                            \
  [[nodiscard]] inline Type fastest##Name() {  \
    return FATHOM_FASTEST_TABLE;               \
  }                                            \
  static_assert(true)

#ifdef __x86_64__
#define FATHOM_FASTEST_TABLE (__builtin_cpu_supports("avx2") ? avx2::table() : baseline::table())
#else
#define FATHOM_FASTEST_TABLE baseline::table()
#endif
