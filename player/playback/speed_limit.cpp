#include "player/playback/speed_limit.h"

#include "player/playback/reference_stream.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace haptrace {
namespace {

constexpr double kStep = 0.01;        // between the nodes of a stretch [s]
constexpr int kSpeedsPerStep = 4;     // speeds that are looked at between two nodes
constexpr std::size_t kMostTold = 3;  // places

}  // namespace

TimeStretch stretch_below(const TrajectoryPieces& pieces, double limit, double ramp) {
  const auto nodes = static_cast<std::size_t>(std::ceil(pieces.duration() / kStep)) + 1;
  std::vector<double> rate(nodes, 1);  // 1 / factor
  std::size_t at = 0;
  for (std::size_t i = 0; i < pieces.count(); ++i) {
    const TrajectoryPiece piece = i == 0 ? *pieces.first() : pieces.make(i);
    const bool last = i + 1 == pieces.count();
    Trajectory::Cursor cursor;
    for (;; ++at) {
      const double t = kStep / kSpeedsPerStep * static_cast<double>(at);
      if (last ? t > piece.end + kStep : t >= piece.end) break;
      const double speed = piece.trajectory.sample(t, cursor).velocity.norm();
      if (!(speed > limit)) continue;
      // Both nodes beside the place, so that the line between them is nowhere below what is needed.
      const std::size_t node = std::min(at / kSpeedsPerStep, nodes - 1);
      for (const std::size_t beside : {node, std::min(node + 1, nodes - 1)})
        rate[beside] = std::min(rate[beside], limit / speed);
    }
  }
  for (std::size_t i = 1; i < nodes; ++i) rate[i] = std::min(rate[i], rate[i - 1] + kStep / ramp);
  for (std::size_t i = nodes - 1; i-- > 0;) rate[i] = std::min(rate[i], rate[i + 1] + kStep / ramp);
  for (double& one : rate) one = 1 / one;
  return {kStep, std::move(rate)};
}

std::string describe(const TimeStretch& stretch) {
  std::vector<std::string> told;
  const std::vector<TimeStretch::Place> places = stretch.places();
  for (const TimeStretch::Place& place : places) {
    if (told.size() == kMostTold) {
      told.push_back(fmt::format("and in {} more places", places.size() - kMostTold));
      break;
    }
    told.push_back(fmt::format("from {:.2f} to {:.2f} s by up to {:.2f}", place.begin, place.end, place.factor));
  }
  return fmt::format("{}", fmt::join(told, ", "));
}

}  // namespace haptrace
