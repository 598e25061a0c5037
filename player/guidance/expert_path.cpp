#include "player/guidance/expert_path.h"

#include "player/playback/reference_stream.h"

#include <algorithm>

namespace haptrace {

void visit_path(const std::shared_ptr<const PathSource>& source, std::optional<double> smoothing,
                const PathVisitor& visit) {
  constexpr double kStep = 1e-3;  // [s]
  const TrajectoryPieces pieces(source, Interpolation::cubic, {.smoothing = smoothing});
  const bool forces = source->facts().force;
  double t = 0;
  std::uint64_t row = 0;
  for (std::size_t i = 0; i < pieces.count(); ++i) {
    const TrajectoryPiece piece = pieces.make(i);
    Path rows;
    std::size_t at = 0;
    if (forces) {
      const std::uint64_t last = source->row_at(source->facts().begin + piece.end);
      rows = source->read(row, last + 2 - row);
      row = last;
    }
    const auto force_at = [&](double when) -> Vec3 {
      if (!forces) return Vec3::Zero();
      const double stamp = when + source->facts().begin;
      while (at + 2 < rows.size() && rows.time[at + 1] <= stamp) ++at;
      if (at + 1 >= rows.size()) return rows.force.back();
      const double share = (stamp - rows.time[at]) / (rows.time[at + 1] - rows.time[at]);
      return rows.force[at] + std::clamp(share, 0.0, 1.0) * (rows.force[at + 1] - rows.force[at]);
    };
    Trajectory::Cursor cursor;
    const bool last = i + 1 == pieces.count();
    for (; t < piece.end; t += kStep) visit(t, piece.trajectory.sample(t, cursor).position, force_at(t));
    if (last) visit(piece.end, piece.trajectory.sample(piece.end, cursor).position, force_at(piece.end));
  }
}

ArcPath expert_path(const std::shared_ptr<const PathSource>& source, std::optional<double> smoothing,
                    std::optional<double> spacing, double radius) {
  ArcPath::Builder builder(spacing.value_or(ArcPath::spacing_for(source->facts().bounds.size().norm())));
  visit_path(source, smoothing,
             [&](double t, const Vec3& position, const Vec3& force) { builder.add(t, position, force); });
  return builder.finish(radius);
}

}  // namespace haptrace
