// What the C++ peers share: reading a problem, measuring, writing the estimate. The same protocol as measure.py.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <memory>
#include <vector>

struct Problem {
  int64_t d = 0, robots = 0, poses = 0, landmarks = 0, steps = 0, sightings = 0;
  std::vector<int64_t> step_from, step_to, seen_from, seen;
  std::vector<double> step_T, step_R, z, T, R, P;  // rotations row by row
  std::vector<double> sigma_T, sigma_R;            // of each step
  double sigma_P = 0;

  explicit Problem(const char* path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      std::cerr << "cannot read " << path << "\n";
      std::exit(2);
    }
    const auto read = [&](auto& out) { file.read(reinterpret_cast<char*>(&out), sizeof out); };
    const auto take = [&](auto& out, int64_t count) {
      out.resize(count);
      file.read(reinterpret_cast<char*>(out.data()), count * sizeof out[0]);
    };
    for (int64_t* count : {&d, &robots, &poses, &landmarks, &steps, &sightings}) read(*count);
    take(step_from, steps), take(step_to, steps), take(seen_from, sightings), take(seen, sightings);
    take(step_T, steps * d), take(step_R, steps * d * d), take(z, sightings * d);
    take(T, poses * d), take(R, poses * d * d), take(P, landmarks * d);
    take(sigma_T, steps), take(sigma_R, steps), read(sigma_P);
  }
};

struct Estimate {
  std::vector<double> T, R, P;
  void save(const char* path) const {
    std::ofstream file(path, std::ios::binary);
    for (const auto* numbers : {&T, &R, &P})
      file.write(reinterpret_cast<const char*>(numbers->data()), numbers->size() * sizeof(double));
  }
};

inline double now_ms() {
  using namespace std::chrono;
  return duration<double, std::milli>(steady_clock::now().time_since_epoch()).count();
}

inline double peak_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::atof(line.c_str() + 6) / 1024.0;
  return 0.0;
}

inline double forget_peak() {
  std::ofstream("/proc/self/clear_refs") << "5";
  return peak_mb();
}

// PROGRAM PROBLEM ESTIMATE REPETITIONS MARGINALS(0|1) VARIANT. `Model` has build in its constructor, solve() -> iterations, read(),
// and marginals() -> the trace of all landmarks' covariances (nan: it has none).
template <class Model>
int measure(int argc, char** argv, const char* version) {
  if (argc != 6) {
    std::cout << version << "\n";
    return argc == 1 ? 0 : 2;
  }
  const Problem problem(argv[1]);
  const int repetitions = std::atoi(argv[3]);
  const double before = forget_peak();
  double peak = 0.0;
  int iterations = 0;
  std::vector<double> build, solve, read, total, cpu;
  std::unique_ptr<Model> model;
  for (int k = 0; k < repetitions + (repetitions > 1); ++k) {
    model.reset();
    const std::clock_t used = std::clock();  // of all threads
    const double began = now_ms();
    model = std::make_unique<Model>(problem, argv[5]);
    const double built = now_ms();
    iterations = model->solve();
    const double solved = now_ms();
    const Estimate estimate = model->read();
    const double ended = now_ms(), busy = 1e3 * static_cast<double>(std::clock() - used) / CLOCKS_PER_SEC;
    if (k == 0) {
      peak = peak_mb() - before;
      estimate.save(argv[2]);
    }
    if (k == 0 && repetitions > 1) continue;  // the first of several warms caches up
    build.push_back(built - began), solve.push_back(solved - built);
    read.push_back(ended - solved), total.push_back(ended - began), cpu.push_back(busy);
  }
  const auto list = [](const std::vector<double>& numbers) {
    std::ostringstream out;
    for (std::size_t i = 0; i < numbers.size(); ++i) out << (i ? ", " : "[") << numbers[i];
    out << "]";
    return out.str();
  };
  std::ostringstream result;
  result.precision(12);
  result << "{\"version\": \"" << version << "\", \"iterations\": " << iterations << ", \"peak_mb\": " << peak
         << ", \"build_ms\": " << list(build) << ", \"solve_ms\": " << list(solve) << ", \"read_ms\": " << list(read)
         << ", \"total_ms\": " << list(total)
         << ", \"cpu_ms\": " << list(cpu);
  std::cout << result.str() << "}" << std::endl;
  if (argv[4][0] != '1') return 0;
  std::vector<double> marginals;
  double trace = 0.0;
  for (int k = 0; k < (solve[0] > 100.0 ? 1 : 5); ++k) {
    const double began = now_ms();
    trace = model->marginals();
    marginals.push_back(now_ms() - began);
  }
  std::cout.precision(12);
  std::cout << result.str() << ", \"marginals_ms\": " << list(marginals) << ", \"trace\": " << trace << "}" << std::endl;
  return 0;
}
