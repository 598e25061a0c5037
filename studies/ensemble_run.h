// Runs the draws of an ensemble on all cores.
#pragma once

#include "base/parallel.h"
#include "base/stopwatch.h"

#include <functional>
#include <limits>
#include <optional>
#include <vector>

namespace haptrace {

struct EnsembleProgress {
  std::size_t done = 0, draws = 0;
  double remaining = std::numeric_limits<double>::quiet_NaN();  ///< remaining time, estimated from the pace so far [s]
};

/// Returns the results of `run(draw)` for draws 0 to draws - 1, in order and independent of `threads` (0: one for every
/// core). If `stop` is raised, only the draws finished before. Calls `progress` in the calling thread about ten times a
/// second. Throws the first exception of a draw.
template <class Member, class Run>
std::vector<Member> run_draws(std::size_t draws, std::size_t threads, const StopRequest& stop, const Run& run,
                              const std::function<void(const EnsembleProgress&)>& progress) {
  std::vector<std::optional<Member>> finished(draws);
  const Stopwatch watch;
  run_parallel(
      draws, threads, stop,
      [&](std::size_t draw) {
        Member member = run(draw);
        if (stop.count() == 0) finished[draw] = std::move(member);
      },
      [&](std::size_t done) {
        if (!progress) return;
        EnsembleProgress told{done, draws};
        if (done > 0) told.remaining = watch.seconds() / static_cast<double>(done) * static_cast<double>(draws - done);
        progress(told);
      });
  std::vector<Member> members;
  for (std::optional<Member>& member : finished)
    if (member) members.push_back(std::move(*member));
  return members;
}

}  // namespace haptrace
