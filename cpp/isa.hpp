// The inner loops are compiled once for every instruction set that pays: a source file that wants another than the
// compiler's own defines TEAMSLAM_ISA (see models_avx2.cpp). The inline namespace keeps the copies apart for the linker.
#pragma once

#ifndef TEAMSLAM_ISA
#define TEAMSLAM_ISA baseline
#endif

// GCC can switch the instruction set inside a file; elsewhere the compiler's own one serves.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define TEAMSLAM_HAS_AVX2 1
#else
#define TEAMSLAM_HAS_AVX2 0
#endif
