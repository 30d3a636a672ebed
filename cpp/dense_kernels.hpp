// The dense kernels themselves, compiled once for every instruction set: define TEAMSLAM_KERNEL (a namespace) and
// TEAMSLAM_TILE (groups of four rows in a register tile), then include this.
//
// A register tile of C, 4 * G rows by up to 4 columns, is loaded, updated over the whole inner dimension and stored
// once. Small operands are read in place; packing pays only for larger ones. Vectors of four doubles map to one AVX
// register, two SSE or NEON registers, or plain loops elsewhere; with TEAMSLAM_WIDE, packed tiles have vectors of eight.
#include <cmath>
#include <limits>

#include "dense.hpp"
#include "dense_tile.hpp"

namespace teamslam::TEAMSLAM_KERNEL {
namespace {

constexpr int64_t packed_columns = 32;  // columns of C taken at a time, their part of B packed
// The inner dimension is taken in parts, so that a packed tile of A fits the first cache.
#if defined(TEAMSLAM_WIDE)
constexpr int64_t tile_rows = 24, depth_limit = 128;
constexpr int strip_columns = 8;  // of a tile
#else
constexpr int64_t tile_rows = 4 * TEAMSLAM_TILE, depth_limit = 256;
constexpr int strip_columns = 4;
#endif

// C -= A B with B(p, j) = b[p * b_inner + j * b_column]; if `lower`, A and C start at the same diagonal entry and only
// tiles that reach the lower triangle are computed. Operands in place: for small matrices.
template <bool lower>
void product_in_place(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading,
                      const double* b, int64_t b_inner, int64_t b_column, double* c, int64_t c_leading) {
  for (int64_t j = 0; j < columns; j += block_width<strip_columns>(columns - j)) {
    with_columns<strip_columns>(columns - j, [&]<int N>() {
      over_tiles(lower ? j : 0, rows, [&]<class V, int G>(int64_t i) {
        Tile<G, N, V> tile;
        tile.read(c + i + j * c_leading, c_leading);
        tile.subtract(inner, a + i, a_leading, b + j * b_column, b_inner, b_column);
        tile.write(c + i + j * c_leading, c_leading);
      });
    });
  }
}

// The same with both operands packed (Goto and van de Geijn 2008): tiles of A and strips of B become contiguous.
template <bool lower>
void product_packed(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading, const double* b,
                    int64_t b_inner, int64_t b_column, double* c, int64_t c_leading) {
  double strips[packed_columns * depth_limit];
  double rows_packed[tile_rows * depth_limit];
  for (int64_t p0 = 0; p0 < inner; p0 += depth_limit) {
    const int64_t depth = least(depth_limit, inner - p0);
    for (int64_t j0 = 0; j0 < columns; j0 += packed_columns) {
      const int64_t width = least(packed_columns, columns - j0);
      for (int64_t j = 0, n = 0; j < width; j += n) {
        n = block_width<strip_columns>(width - j);
        double* to = strips + j * depth;
        const double* from = b + p0 * b_inner + (j0 + j) * b_column;
        for (int64_t p = 0; p < depth; ++p) {
          for (int64_t q = 0; q < n; ++q) to[p * n + q] = from[p * b_inner + q * b_column];
        }
      }
      over_tiles(lower ? j0 : 0, rows, [&]<class V, int G>(int64_t i) {
        constexpr int high = G * (sizeof(V) / sizeof(double));
        const double* from = a + i + p0 * a_leading;
        for (int64_t p = 0; p < depth; ++p) {
          for (int r = 0; r < high; r += 4) store(rows_packed + p * high + r, load(from + p * a_leading + r));
        }
        const int64_t end = lower ? least(width, i + high - j0) : width;
        for (int64_t j = 0; j < end; j += block_width<strip_columns>(width - j)) {
          with_columns<strip_columns>(width - j, [&]<int N>() {
            Tile<G, N, V> tile;
            double* at = c + i + (j0 + j) * c_leading;
            tile.read(at, c_leading);
            tile.subtract(depth, rows_packed, high, strips + j * depth, N, 1);
            tile.write(at, c_leading);
          });
        }
      });
    }
  }
}

template <bool lower>
void product(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading, const double* b,
             int64_t b_inner, int64_t b_column, double* c, int64_t c_leading) {
  const bool large = rows >= 64 && columns >= 16 && inner >= 16;
  (large ? product_packed<lower> : product_in_place<lower>)(rows, columns, inner, a, a_leading, b, b_inner, b_column, c,
                                                            c_leading);
}

void subtract_product(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading,
                      const double* b, int64_t b_inner, int64_t b_column, double* c, int64_t c_leading) {
  product<false>(rows, columns, inner, a, a_leading, b, b_inner, b_column, c, c_leading);
}

void subtract_square(int64_t rows, int64_t inner, const double* a, int64_t a_leading, double* c, int64_t c_leading,
                     int64_t begin, int64_t end) {
  product<true>(rows - begin, end - begin, inner, a + begin, a_leading, a + begin, a_leading, 1,
                c + begin * (c_leading + 1), c_leading);
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

constexpr int64_t block = 64;  // columns of a triangle that are divided by in place

void divide_transposed(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse,
                       double* x, int64_t x_leading) {
  for (int64_t j0 = 0; j0 < columns; j0 += block) {
    const int64_t width = least(block, columns - j0);
    const double* own = l + j0 * (l_leading + 1);
    double* at = x + j0 * x_leading;
    if (j0 > 0) product<false>(rows, width, j0, x, x_leading, l + j0, l_leading, 1, at, x_leading);
    over_rows(0, rows, [&]<int G>(int64_t i) {
      for (int64_t j = 0; j < width; j += 4) {
        with_columns(width - j, [&]<int N>() {
          Tile<G, N> tile;
          tile.read(at + i + j * x_leading, x_leading);
          tile.subtract(j, at + i, x_leading, own + j, l_leading, 1);
          tile.divide_transposed(own + j * (l_leading + 1), l_leading, inverse + j0 + j);
          tile.write(at + i + j * x_leading, x_leading);
        });
      }
    });
  }
}

void divide(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse, double* x,
            int64_t x_leading) {
  for (int64_t j0 = ((columns - 1) / block) * block; j0 >= 0; j0 -= block) {
    const int64_t width = least(block, columns - j0), after = j0 + width;
    const double* own = l + j0 * (l_leading + 1);
    double* at = x + j0 * x_leading;
    if (after < columns) {
      product<false>(rows, width, columns - after, x + after * x_leading, x_leading, l + after + j0 * l_leading, 1,
                     l_leading, at, x_leading);
    }
    over_rows(0, rows, [&]<int G>(int64_t i) {
      for (int64_t j = (width - 1) & ~int64_t{3}; j >= 0; j -= 4) {
        with_columns(width - j, [&]<int N>() {
          Tile<G, N> tile;
          tile.read(at + i + j * x_leading, x_leading);
          tile.subtract(width - j - N, at + i + (j + N) * x_leading, x_leading, own + j + N + j * l_leading, 1,
                        l_leading);
          tile.divide(own + j * (l_leading + 1), l_leading, inverse + j0 + j);
          tile.write(at + i + j * x_leading, x_leading);
        });
      }
    });
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
  const auto sum_of = [](Vector v) {
    double part[4];
    store(part, v);
    return (part[0] + part[1]) + (part[2] + part[3]);
  };
  const auto finish = [&](int64_t j, double value) {
    for (int64_t i = columns - 1; i > j; --i) value -= d[i + j * d_leading] * x[i];
    x[j] = value * inverse[j];
  };
  int64_t j = columns;
  for (; j >= 4; j -= 4) {  // four columns at a time share the loads of t and hide each other's latency
    Vector sum[4] = {broadcast(0), broadcast(0), broadcast(0), broadcast(0)};
    const double* column = l + (j - 4) * l_leading;
    for (int64_t i = 0; i < rows; i += 4) {
      const Vector u = load(t + i);
      for (int q = 0; q < 4; ++q) sum[q] = sum[q] + load(column + q * l_leading + i) * u;
    }
    for (int q = 3; q >= 0; --q) finish(j - 4 + q, x[j - 4 + q] - sum_of(sum[q]));
  }
  for (; j > 0; --j) {
    Vector sum = broadcast(0);
    const double* column = l + (j - 1) * l_leading;
    for (int64_t i = 0; i < rows; i += 4) sum = sum + load(column + i) * load(t + i);
    finish(j - 1, x[j - 1] - sum_of(sum));
  }
}

}  // namespace

extern const DenseKernels kernels;
const DenseKernels kernels = {TEAMSLAM_KERNEL_NAME, subtract_product, subtract_square,
                              factor,               divide_transposed, divide,
                              extend_add,           forward_one,      backward_one};

}  // namespace teamslam::TEAMSLAM_KERNEL
