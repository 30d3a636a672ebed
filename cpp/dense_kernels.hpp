// The dense kernels themselves, compiled once for every instruction set: define TEAMSLAM_KERNEL (a namespace) and
// TEAMSLAM_TILE (groups of four rows in a register tile), then include this.
//
// A register tile of C, 4 * G rows by up to 4 columns, is loaded, updated over the whole inner dimension and stored
// once. Operands are read in place: the fronts are small enough to stay in cache, so packing would cost more than it
// saves. Vectors of four doubles map to one AVX register, two SSE or NEON registers, or plain loops elsewhere.
#include <cmath>
#include <cstring>
#include <limits>

#include "dense.hpp"

namespace teamslam::TEAMSLAM_KERNEL {
namespace {

#if defined(__GNUC__) || defined(__clang__)
typedef double Vector __attribute__((vector_size(32)));
inline Vector broadcast(double x) { return Vector{x, x, x, x}; }
#else
struct Vector {
  double v[4];
};
inline Vector broadcast(double x) { return {{x, x, x, x}}; }
inline Vector operator*(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] *= b.v[i];
  return a;
}
inline Vector operator+(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] += b.v[i];
  return a;
}
inline Vector operator-(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] -= b.v[i];
  return a;
}
#endif

// Not std::min: an inline function shared with other files must not be compiled for this instruction set.
inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
inline int64_t most(int64_t a, int64_t b) { return a < b ? b : a; }

inline Vector load(const double* p) {
  Vector v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
inline void store(double* p, Vector v) { std::memcpy(p, &v, sizeof v); }

template <int G, int N>
struct Tile {
  Vector at[N][G];

  inline void read(const double* c, int64_t leading) {
    for (int j = 0; j < N; ++j)
      for (int g = 0; g < G; ++g) at[j][g] = load(c + j * leading + 4 * g);
  }
  inline void write(double* c, int64_t leading) const {
    for (int j = 0; j < N; ++j)
      for (int g = 0; g < G; ++g) store(c + j * leading + 4 * g, at[j][g]);
  }
  inline void subtract(int64_t inner, const double* a, int64_t a_leading, const double* b, int64_t b_inner,
                       int64_t b_column) {
    for (int64_t p = 0; p < inner; ++p) {
      Vector rows[G];
      for (int g = 0; g < G; ++g) rows[g] = load(a + 4 * g);
      for (int j = 0; j < N; ++j) {
        const Vector x = broadcast(b[j * b_column]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - rows[g] * x;
      }
      a += a_leading;
      b += b_inner;
    }
  }
  // at = at * T^-T, T the N x N lower triangle at t.
  inline void divide_transposed(const double* t, int64_t leading, const double* inverse) {
    for (int j = 0; j < N; ++j) {
      for (int q = 0; q < j; ++q) {
        const Vector x = broadcast(t[j + q * leading]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - at[q][g] * x;
      }
      const Vector x = broadcast(inverse[j]);
      for (int g = 0; g < G; ++g) at[j][g] = at[j][g] * x;
    }
  }
  // at = at * T^-1.
  inline void divide(const double* t, int64_t leading, const double* inverse) {
    for (int j = N - 1; j >= 0; --j) {
      for (int q = j + 1; q < N; ++q) {
        const Vector x = broadcast(t[q + j * leading]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - at[q][g] * x;
      }
      const Vector x = broadcast(inverse[j]);
      for (int g = 0; g < G; ++g) at[j][g] = at[j][g] * x;
    }
  }
};

// Calls body.operator()<G>(row) over all rows, in tiles of TEAMSLAM_TILE groups and smaller ones at the end.
template <class Body>
inline void over_rows(int64_t begin, int64_t end, const Body& body) {
  constexpr int G = TEAMSLAM_TILE;
  int64_t i = begin;
  for (; i + 4 * G <= end; i += 4 * G) body.template operator()<G>(i);
  if constexpr (G > 2) {
    if (i + 8 <= end) {
      body.template operator()<2>(i);
      i += 8;
    }
  }
  for (; i < end; i += 4) body.template operator()<1>(i);
}

// Calls body.operator()<N>() with N the number of columns in a block, 1 .. 4.
template <class Body>
inline void with_columns(int64_t columns, const Body& body) {
  if (columns >= 4) {
    body.template operator()<4>();
  } else if (columns == 3) {
    body.template operator()<3>();
  } else if (columns == 2) {
    body.template operator()<2>();
  } else if (columns == 1) {
    body.template operator()<1>();
  }
}

constexpr int64_t row_chunk = 96;      // rows whose operands stay in the first-level cache
constexpr int64_t column_chunk = 256;  // inner dimension taken at a time

void subtract_product(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading,
                      const double* b, int64_t b_inner, int64_t b_column, double* c, int64_t c_leading) {
  for (int64_t p = 0; p < inner; p += column_chunk) {
    const int64_t depth = least(column_chunk, inner - p);
    for (int64_t i0 = 0; i0 < rows; i0 += row_chunk) {
      const int64_t i1 = least(rows, i0 + row_chunk);
      for (int64_t j = 0; j < columns; j += 4) {
        with_columns(columns - j, [&]<int N>() {
          over_rows(i0, i1, [&]<int G>(int64_t i) {
            Tile<G, N> tile;
            tile.read(c + i + j * c_leading, c_leading);
            tile.subtract(depth, a + i + p * a_leading, a_leading, b + p * b_inner + j * b_column, b_inner, b_column);
            tile.write(c + i + j * c_leading, c_leading);
          });
        });
      }
    }
  }
}

void subtract_square(int64_t rows, int64_t inner, const double* a, int64_t a_leading, double* c, int64_t c_leading,
                     int64_t begin, int64_t end) {
  for (int64_t p = 0; p < inner; p += column_chunk) {
    const int64_t depth = least(column_chunk, inner - p);
    const double* from = a + p * a_leading;
    for (int64_t i0 = begin; i0 < rows; i0 += row_chunk) {
      const int64_t i1 = least(rows, i0 + row_chunk);
      for (int64_t j = begin; j < least(end, i1); j += 4) {
        over_rows(most(i0, j), i1, [&]<int G>(int64_t i) {
          Tile<G, 4> tile;
          tile.read(c + i + j * c_leading, c_leading);
          tile.subtract(depth, from + i, a_leading, from + j, a_leading, 1);
          tile.write(c + i + j * c_leading, c_leading);
        });
      }
    }
  }
}

// Factors the N x N block at d (its earlier columns already subtracted). Returns the failing column or -1.
template <int N>
inline int64_t factor_block(double* d, int64_t leading, const double* lowest, double* inverse) {
  for (int j = 0; j < N; ++j) {
    const double pivot = d[j + j * leading];
    if (!(pivot > lowest[j] && pivot <= std::numeric_limits<double>::max())) return j;
    const double root = std::sqrt(pivot);
    const double scale = 1 / root;
    d[j + j * leading] = root;
    inverse[j] = scale;
    for (int i = j + 1; i < N; ++i) d[i + j * leading] *= scale;
    for (int k = j + 1; k < N; ++k)
      for (int i = k; i < N; ++i) d[i + k * leading] -= d[i + j * leading] * d[k + j * leading];
  }
  return -1;
}

int64_t factor(int64_t columns, double* d, int64_t leading, const double* lowest, double* inverse) {
  const int64_t rows = (columns + 3) & ~int64_t{3};
  for (int64_t j = 0; j < columns; j += 4) {
    int64_t failed = -1;
    with_columns(columns - j, [&]<int N>() {
      double* block = d + j + j * leading;
      if (j > 0) {
        Tile<1, N> tile;
        tile.read(block, leading);
        tile.subtract(j, d + j, leading, d + j, leading, 1);
        tile.write(block, leading);
      }
      failed = factor_block<N>(block, leading, lowest + j, inverse + j);
      if (failed >= 0) return;
      over_rows(j + 4, rows, [&]<int G>(int64_t i) {
        Tile<G, N> tile;
        tile.read(d + i + j * leading, leading);
        tile.subtract(j, d + i, leading, d + j, leading, 1);
        tile.divide_transposed(block, leading, inverse + j);
        tile.write(d + i + j * leading, leading);
      });
    });
    if (failed >= 0) return j + failed;
  }
  return -1;
}

void divide_transposed(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse,
                       double* x, int64_t x_leading) {
  for (int64_t i0 = 0; i0 < rows; i0 += row_chunk) {
    const int64_t i1 = least(rows, i0 + row_chunk);
    for (int64_t j = 0; j < columns; j += 4) {
      with_columns(columns - j, [&]<int N>() {
        over_rows(i0, i1, [&]<int G>(int64_t i) {
          Tile<G, N> tile;
          tile.read(x + i + j * x_leading, x_leading);
          tile.subtract(j, x + i, x_leading, l + j, l_leading, 1);
          tile.divide_transposed(l + j + j * l_leading, l_leading, inverse + j);
          tile.write(x + i + j * x_leading, x_leading);
        });
      });
    }
  }
}

void divide(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse, double* x,
            int64_t x_leading) {
  for (int64_t i0 = 0; i0 < rows; i0 += row_chunk) {
    const int64_t i1 = least(rows, i0 + row_chunk);
    for (int64_t j = (columns - 1) & ~int64_t{3}; j >= 0; j -= 4) {
      with_columns(columns - j, [&]<int N>() {
        const int64_t after = j + N;
        over_rows(i0, i1, [&]<int G>(int64_t i) {
          Tile<G, N> tile;
          tile.read(x + i + j * x_leading, x_leading);
          tile.subtract(columns - after, x + i + after * x_leading, x_leading, l + after + j * l_leading, 1,
                        l_leading);
          tile.divide(l + j + j * l_leading, l_leading, inverse + j);
          tile.write(x + i + j * x_leading, x_leading);
        });
      });
    }
  }
}

// The lower triangle of an update matrix, column by column, in runs of rows.
void extend_add(const double* update, int64_t leading, const Run* run, int64_t runs, const Destination& to,
                int64_t begin, int64_t end) {
  const auto add = [](double* c, const double* u, int64_t length) {
    int64_t i = 0;
    for (; i + 4 <= length; i += 4) {
      Vector sum = load(c + i);
      sum = sum + load(u + i);
      store(c + i, sum);
    }
    for (; i < length; ++i) c[i] += u[i];
  };
  int64_t below = 0;  // first run beyond the pivots
  while (below < runs && run[below].to < to.columns) ++below;
  for (int64_t r = 0; r < runs; ++r) {
    const bool pivots = r < below;
    for (int64_t j = most(0, begin - run[r].to); j < run[r].length; ++j) {
      const int64_t column = run[r].to + j;
      if (column >= end) return;
      const double* u = update + (run[r].from + j) * leading;
      double* top = to.pivots + column * to.pivot_leading;
      double* rest = pivots ? to.rows + column * to.row_leading
                            : to.update + (column - to.columns) * to.row_leading;
      rest -= to.columns;
      double* own = pivots ? top : rest;
      add(own + column, u + run[r].from + j, run[r].length - j);
      int64_t q = r + 1;
      for (; q < below; ++q) add(top + run[q].to, u + run[q].from, run[q].length);
      for (; q < runs; ++q) add(rest + run[q].to, u + run[q].from, run[q].length);
    }
  }
}

void forward_one(int64_t columns, int64_t rows, const double* d, int64_t d_leading, const double* l, int64_t l_leading,
                 const double* inverse, double* x, double* t) {
  for (int64_t j = 0; j < columns; ++j) {
    const double* column = d + j * d_leading;
    x[j] *= inverse[j];
    for (int64_t i = j + 1; i < columns; ++i) x[i] -= column[i] * x[j];
  }
  over_rows(0, rows, [&]<int G>(int64_t i) {
    Tile<G, 1> tile;
    for (int g = 0; g < G; ++g) tile.at[0][g] = broadcast(0);
    tile.subtract(columns, l + i, l_leading, x, 1, 1);
    tile.write(t + i, 0);
  });
}

void backward_one(int64_t columns, int64_t rows, const double* d, int64_t d_leading, const double* l, int64_t l_leading,
                  const double* inverse, double* x, const double* t) {
  for (int64_t j = columns - 1; j >= 0; --j) {
    const double* column = l + j * l_leading;
    Vector sum = broadcast(0);
    for (int64_t i = 0; i < rows; i += 4) sum = sum + load(column + i) * load(t + i);
    double part[4];
    store(part, sum);
    double value = x[j] - ((part[0] + part[1]) + (part[2] + part[3]));
    for (int64_t i = j + 1; i < columns; ++i) value -= d[i + j * d_leading] * x[i];
    x[j] = value * inverse[j];
  }
}

}  // namespace

extern const DenseKernels kernels;
const DenseKernels kernels = {TEAMSLAM_KERNEL_NAME, subtract_product, subtract_square,
                              factor,               divide_transposed, divide,
                              extend_add,           forward_one,      backward_one};

}  // namespace teamslam::TEAMSLAM_KERNEL
