// haptrace_place [TRIALS [SEED]]: how well PlaceTracker keeps the place of trainees who depart from the expert's path,
// on ten paths. TRIALS (default 8) are those of each departure on each path. docs/guiding.md has the results.
#include "tests/control/path/trainees.h"

#include <algorithm>
#include <cstdlib>
#include <fmt/format.h>
#include <numbers>

namespace haptrace::test {
namespace {

struct Group {
  std::string name;
  std::vector<Departure> departures;
  bool counts = true;  ///< in the total
};

std::vector<Group> groups() {
  constexpr double kDegree = std::numbers::pi / 180;
  const auto scaled = [](std::initializer_list<double> factors, bool about_start) {
    std::vector<Departure> all;
    for (const double factor : factors) all.push_back({.scale = factor, .about_start = about_start});
    return all;
  };
  return {
      {"good: noise 1, 2 mm, speed 1/4 to 4, a stop",
       {{.noise = 1e-3}, {.noise = 2e-3}, {.speed = 0.25}, {.speed = 0.5}, {.speed = 2}, {.speed = 4}, {.stop = 3}}},
      {"scaled 0.7 to 1.3 about the centre", scaled({0.7, 0.8, 0.9, 1.1, 1.2, 1.3}, false)},
      {"scaled 0.7 to 1.3 about the start", scaled({0.7, 0.8, 0.9, 1.1, 1.2, 1.3}, true)},
      {"scaled 0.5 and 0.6 about the centre", scaled({0.5, 0.6}, false), false},
      {"shifted 5, 10, 15 mm", {{.shift = 5e-3}, {.shift = 10e-3}, {.shift = 15e-3}}},
      {"rotated 5, 10, 20 degrees",
       {{.rotation = 5 * kDegree}, {.rotation = 10 * kDegree}, {.rotation = 20 * kDegree}}},
      {"low-passed at 1 and 0.5 Hz", {{.low_pass = 1}, {.low_pass = 0.5}}},
      {"low-passed at 0.3 Hz", {{.low_pass = 0.3}}, false},
      {"turns early or cuts corners by 2 to 15 mm",
       {{.early = 2e-3}, {.early = 3e-3}, {.early = 5e-3}, {.early = 8e-3}, {.early = 15e-3}}},
      {"goes back 20 mm", {{.back = 0.02}}},
      {"goes back 60 and 100 mm, and to the start", {{.back = 0.06}, {.back = 0.1}, {.again = true}}, false},
      {"skips 40 and 60 mm", {{.skip = 0.04}, {.skip = 0.06}}},
      {"starts in the middle", {{.middle = true}}},
      {"wanders 50 mm off", {{.wander = 0.05}}},
      {"tremor of 5 mm at 5 Hz", {{.tremor = 5e-3}}},
      {"shakes by 2 to 4 mm at one place for 20 s", {{.shake = 2e-3}, {.shake = 3e-3}, {.shake = 4e-3}}},
      {"mixtures",
       {{.noise = 1e-3, .speed = 1.5, .scale = 0.85, .shift = 5e-3, .early = 4e-3},
        {.noise = 1e-3, .scale = 1.15, .rotation = 8 * kDegree, .tremor = 2e-3}}},
  };
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return kNaN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

void study(int trials, std::uint64_t seed, bool verbose) {
  fmt::print("{:<46} {:>11} {:>6} {:>10} {:>10} {:>8} {:>9}\n", "trainee", "kept", "jumps", "wrong [s]", "wall [mm]",
             "doubt", "rms [mm]");
  int all_kept = 0, all_count = 0, all_jumps = 0;
  double fastest = 0;
  for (const Group& group : groups()) {
    int kept = 0, count = 0, jumps = 0;
    double wall = 0, doubt = 0;
    std::vector<double> wrong, errors;
    for (const Stroke& stroke : strokes()) {
      const ArcPath path = path_of(stroke, 5e-3);
      for (std::size_t d = 0; d < group.departures.size(); ++d) {
        if (group.departures[d].early > 0 && stroke.corners.empty()) continue;
        for (int i = 0; i < trials; ++i) {
          const Verdict verdict = judge(path, trial_of(stroke, path, group.departures[d], seed + 1000 * d + 7 * i));
          kept += verdict.kept ? 1 : 0;
          jumps += verdict.jumps;
          ++count;
          wall = std::max(wall, verdict.wrong_wall);
          doubt += verdict.doubt;
          if (verdict.longest_wrong > 0) wrong.push_back(verdict.longest_wrong);
          errors.push_back(verdict.error);
          fastest = std::max(fastest, verdict.fastest);
          if (verbose && (!verdict.kept || verdict.jumps > 0 || verdict.wrong_wall > 1e-3))
            fmt::print("  {} departure {} trial {}: kept {} jumps {} wrong {:.2f} s wall {:.1f} mm\n", stroke.name, d,
                       i, verdict.kept, verdict.jumps, verdict.longest_wrong, 1e3 * verdict.wrong_wall);
        }
      }
    }
    fmt::print("{:<46} {:>5}/{:<5} {:>6} {:>4.2f} {:>5.2f} {:>10.1f} {:>7.1f}% {:>9.1f}\n", group.name, kept, count,
               jumps, percentile(wrong, 0.5), percentile(wrong, 1), 1e3 * wall, 100 * doubt / count,
               1e3 * percentile(errors, 0.5));
    if (!group.counts) continue;
    all_kept += kept;
    all_count += count;
    all_jumps += jumps;
  }
  fmt::print(
      "all that count: {} of {} kept, {:.1f} %; {} jumps to a wrong strand; fastest place beyond the hand {:.2f} mm a "
      "tick\n",
      all_kept, all_count, 100.0 * all_kept / all_count, all_jumps, 1e3 * fastest);
}

}  // namespace
}  // namespace haptrace::test

int main(int argc, char** argv) {
  haptrace::test::study(argc > 1 ? std::atoi(argv[1]) : 8,
                        argc > 2 ? static_cast<std::uint64_t>(std::atoll(argv[2])) : 1, argc > 3);
  return 0;
}
