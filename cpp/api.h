/* The C interface of the kernel: arrays in, arrays out. src/teamslam/kernel/ is its one client.
 *
 * Functions that can fail return a negative number (or null) and leave a message in teamslam_error(), which belongs to
 * the calling thread. Lengths of arrays are the caller's duty; what stands in them is checked here. Conventions, models
 * and layouts: kinds.hpp, models.hpp, submap_term.hpp, block_matrix.hpp, cholesky.hpp. */
#ifndef TEAMSLAM_API_H
#define TEAMSLAM_API_H

#include <stdint.h>

#if defined(_WIN32)
#define TEAMSLAM_API __declspec(dllexport)
#else
#define TEAMSLAM_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct teamslam_blocks teamslam_blocks;
typedef struct teamslam_problem teamslam_problem;
typedef struct teamslam_analysis teamslam_analysis;
typedef struct teamslam_factor teamslam_factor;
typedef struct teamslam_condensation teamslam_condensation;

TEAMSLAM_API const char* teamslam_error(void);
TEAMSLAM_API void teamslam_set_threads(int32_t threads);

/* shape: keys, numbers of a measurement, rows of a residual. */
TEAMSLAM_API void teamslam_model_shape(int32_t model, int32_t dimension, int32_t shape[3]);

/* A block matrix by rows of scalars, both triangles (sparse_rows.hpp). */
TEAMSLAM_API int32_t teamslam_sparse_rows(int64_t variables, const int32_t* dof, const int64_t* column_start,
                                          const int32_t* row, const double* values, int64_t* start, int32_t* column,
                                          double* value);
/* And back: the blocks of such rows, first counted (sizes: blocks, values), then taken, which frees them. */
TEAMSLAM_API teamslam_blocks* teamslam_blocks_new(int64_t variables, const int32_t* dof, const int64_t* start,
                                                  const int32_t* column, const double* value, int64_t sizes[2]);
TEAMSLAM_API void teamslam_blocks_take(teamslam_blocks* blocks, int64_t* column_start, int32_t* row, double* values);

/* --- problems ---------------------------------------------------------------------------------------------------- */

TEAMSLAM_API teamslam_problem* teamslam_problem_new(int64_t variables, const int32_t* kinds, const uint8_t* fixed);
TEAMSLAM_API void teamslam_problem_free(teamslam_problem* problem);

/* These return the handle of the new term. sensor, eta may be null. */
TEAMSLAM_API int64_t teamslam_add_table(teamslam_problem* problem, int32_t model, int32_t dimension, int64_t rows,
                                        const int64_t* index, const double* z, const double* whitening,
                                        int32_t shared_whitening, const double* sensor, int32_t loss, double scale);
TEAMSLAM_API int64_t teamslam_add_submap(teamslam_problem* problem, int64_t base, int64_t members,
                                         const int64_t* member, const int32_t* kind, const double* state,
                                         const int64_t* column_start, const int32_t* row, const double* values,
                                         const double* eta);
/* Many submaps at once, their arrays one after another. The information is by rows of scalars (sparse_rows.hpp): start
 * has one number more than the submap has unknowns, and begins with 0 for each; column and values point to each one's own.
 * Returns the first handle, the others follow; sizes: the stored values of each information. */
TEAMSLAM_API int64_t teamslam_add_submaps(teamslam_problem* problem, int64_t count, const int64_t* base,
                                          const int64_t* members, const int64_t* member, const int32_t* kind,
                                          const double* state, const int64_t* start, const int32_t* const* column,
                                          const double* const* values, const double* eta, int64_t* sizes);
TEAMSLAM_API int64_t teamslam_add_blocks(teamslam_problem* problem, int64_t count, int64_t keys, const int64_t* index,
                                         int64_t residual_rows);
TEAMSLAM_API int32_t teamslam_set_weights(teamslam_problem* problem, int64_t handle, const double* weights);
/* As of teamslam_add_table, in the place of what was given there. */
TEAMSLAM_API int32_t teamslam_set_whitening(teamslam_problem* problem, int64_t handle, const double* whitening,
                                            int32_t shared_whitening);
/* curvature, of any term: 0 none, 1 of its loss, 2 of its loss and residuals (curvature.hpp). */
TEAMSLAM_API int32_t teamslam_set_curvature(teamslam_problem* problem, int64_t handle, int32_t curvature);
TEAMSLAM_API int32_t teamslam_set_submap(teamslam_problem* problem, int64_t handle, const double* state,
                                         const double* values, const double* eta);

/* home: the variable that carries each one when it is retracted, or -1 (retraction.hpp). */
TEAMSLAM_API int32_t teamslam_set_homes(teamslam_problem* problem, const int64_t* home);

/* One table alone, linearised once (normal_equations.hpp): H (n x n, both triangles) and g (n) over all unknowns. */
TEAMSLAM_API int32_t teamslam_normal_equations(int64_t variables, const int32_t* kinds, int32_t model, int32_t dimension,
                                               int64_t rows, const int64_t* index, const double* z,
                                               const double* whitening, int32_t shared_whitening, const double* sensor,
                                               int32_t loss, double scale, const double* state, double* H, double* g,
                                               double* cost);

/* A robot's filter (filter.hpp), over variables of which the first is the pose of now. Rows are a table, whose index names
 * variables; or, where `linearise` is not null, a user's, of `keys` variables and `residuals` numbers each: it gives e and
 * J as of filter.hpp, and 0, or a number below it where it failed. Return 1, or 0 where nothing was done: where rows leave
 * something open or are not finite. sensor may be null.
 * moved: index names the old pose X (0) and the new one (1), which begins at X o step, or X o step^-1. */
typedef int32_t (*teamslam_linearise_rows)(const double* state, double* e, double* J);
TEAMSLAM_API int32_t teamslam_moved(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                                    const double* state, const double* covariance, int32_t model, int32_t dimension,
                                    int64_t rows, const int64_t* index, const double* z, const double* whitening,
                                    int32_t shared_whitening, const double* sensor, int32_t loss, double scale,
                                    int32_t keys, int64_t residuals, teamslam_linearise_rows linearise,
                                    const double* step, int32_t backward, int32_t settled, double* moved_state,
                                    double* moved_covariance);
TEAMSLAM_API int32_t teamslam_seen(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                                   const double* state, const double* covariance, int32_t model, int32_t dimension,
                                   int64_t rows, const int64_t* index, const double* z, const double* whitening,
                                   int32_t shared_whitening, const double* sensor, int32_t loss, double scale,
                                   int32_t keys, int64_t residuals, teamslam_linearise_rows linearise,
                                   int64_t most, double little, double* seen_state, double* seen_covariance);
/* told (telling.hpp): landmarks of a map at the places `fresh`, for a filter of which `theirs` places in the map what does
 * not turn, one each. */
TEAMSLAM_API int32_t teamslam_told(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                                   const double* state, const double* covariance, int64_t map_variables,
                                   const int32_t* map_kinds, const double* map_state, const double* map_covariance,
                                   const int64_t* theirs, int64_t count, const int64_t* fresh, double* told_state,
                                   double* told_covariance);

/* Fixes the structure. sizes: free variables, blocks, values of H, unknowns, numbers of the linear system. */
TEAMSLAM_API int32_t teamslam_freeze(teamslam_problem* problem, int64_t sizes[5]);
TEAMSLAM_API void teamslam_pattern(const teamslam_problem* problem, int32_t* dof, int64_t* column_start, int32_t* row);

/* system: [values of H | g | working room]. Each user's block must be named once: its e and J, whitened and weighted. */
TEAMSLAM_API int32_t teamslam_linearise(teamslam_problem* problem, const double* state, int64_t user_blocks,
                                        const int64_t* handles, const double* const* e, const double* const* J,
                                        double* system, double* cost);
/* The same of a problem of submaps, without H, whose place in the system is left as it is. */
TEAMSLAM_API int32_t teamslam_slope(teamslam_problem* problem, const double* state, double* system, double* cost);
TEAMSLAM_API int32_t teamslam_cost(teamslam_problem* problem, const double* state, double* cost);
/* The most information that any submap has on one number. */
TEAMSLAM_API double teamslam_sharpest(const teamslam_problem* problem);
TEAMSLAM_API int32_t teamslam_residuals(teamslam_problem* problem, int64_t handle, const double* state,
                                        double* whitened);
/* -de/dx, whitened: rows x residuals of a row x 12, the unknowns of the first variable, then those of the second; zeros
   before the call. */
TEAMSLAM_API int32_t teamslam_jacobians(teamslam_problem* problem, int64_t handle, const double* state,
                                        double* whitened);
/* Products with them, row-major with `columns` columns: WJ y, rows x residuals of a row; J'W'u, added to the sums over
   the unknowns. */
TEAMSLAM_API int32_t teamslam_along(teamslam_problem* problem, int64_t handle, const double* state, const double* y,
                                    int64_t columns, double* whitened);
TEAMSLAM_API int32_t teamslam_pull(teamslam_problem* problem, int64_t handle, const double* state,
                                   const double* whitened, int64_t columns, double* sums);
/* row: the first row of a table, or member of a submap, of which a residual, Jacobian or cost is not finite; or -1. */
TEAMSLAM_API int32_t teamslam_fault(teamslam_problem* problem, int64_t handle, const double* state, int64_t* row);
TEAMSLAM_API int32_t teamslam_retract(teamslam_problem* problem, const double* state, const double* delta, double* out);

/* --- Cholesky factors -------------------------------------------------------------------------------------------- */

/* ordering: 0 automatic, 1 minimum degree, 2 nested dissection, 3 geometric, 4 natural. positions, last may be null. */
TEAMSLAM_API teamslam_analysis* teamslam_analysis_new(int64_t variables, const int32_t* dof,
                                                      const int64_t* column_start, const int32_t* row,
                                                      int32_t ordering, const double* positions, const int32_t* last,
                                                      int32_t last_count);
TEAMSLAM_API void teamslam_analysis_free(teamslam_analysis* analysis);

/* A factor keeps what it needs of its analysis, which may be freed before it. */
TEAMSLAM_API teamslam_factor* teamslam_factor_new(const teamslam_analysis* analysis);
TEAMSLAM_API void teamslam_factor_free(teamslam_factor* factor);

/* pivot: -1, or the variable at which a pivot was not positive. */
TEAMSLAM_API int32_t teamslam_factorise(teamslam_factor* factor, const double* values, const double* damping,
                                        int32_t* pivot);
/* rhs: unknowns x columns, row-major, solved in place. */
TEAMSLAM_API int32_t teamslam_solve(const teamslam_factor* factor, double* rhs, int64_t columns);
TEAMSLAM_API int32_t teamslam_solve_lower(const teamslam_factor* factor, double* rhs, int64_t columns);
TEAMSLAM_API int32_t teamslam_solve_upper(const teamslam_factor* factor, double* rhs, int64_t columns);
TEAMSLAM_API double teamslam_log_determinant(const teamslam_factor* factor);
TEAMSLAM_API int32_t teamslam_inverse_on_pattern(const teamslam_factor* factor, double* values);
TEAMSLAM_API int32_t teamslam_diagonal_inverse(const teamslam_factor* factor, const int32_t* variables, int64_t count,
                                               double* blocks);
TEAMSLAM_API int32_t teamslam_eliminate(teamslam_factor* factor, const double* values, const double* damping,
                                        double* complement, const double* rhs, double* reduced_rhs, int32_t* pivot);
TEAMSLAM_API int32_t teamslam_back_substitute(const teamslam_factor* factor, const double* last_solution,
                                              double* rhs_inout);
/* order: the variable at each elimination position. */
TEAMSLAM_API void teamslam_order(const teamslam_factor* factor, int64_t variables, int32_t* order);
/* numbers: nonzeros of L, flops of one factorisation, bytes held, the ordering used. */
TEAMSLAM_API void teamslam_statistics(const teamslam_factor* factor, double numbers[4]);

/* --- Condensed matrices ------------------------------------------------------------------------------------------ */

/* A matrix by rows of scalars without the variables that are `gone` (condensation.hpp); on return `gone` says which went.
 * sizes: blocks and values of what stays, and -1 or the variable at which a pivot was not positive. */
TEAMSLAM_API teamslam_condensation* teamslam_condensation_new(int64_t variables, const int32_t* dof,
                                                              const int64_t* start, const int32_t* column,
                                                              const double* value, uint8_t* gone, int32_t frugal,
                                                              int64_t sizes[3]);
TEAMSLAM_API void teamslam_condensation_free(teamslam_condensation* condensation);
/* What stays, by rows of scalars: start, column and value as of teamslam_sparse_rows. */
TEAMSLAM_API int32_t teamslam_condensed_rows(const teamslam_condensation* condensation, int64_t* start, int32_t* column,
                                             double* value);
/* The move of what is gone that follows that of what stays. */
TEAMSLAM_API int32_t teamslam_follow(const teamslam_condensation* condensation, const double* stays, double* gone);

#ifdef __cplusplus
}
#endif

#endif
