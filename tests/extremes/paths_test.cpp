// Tests of paths without length, of one point and of ten million, of a nanometre and of ten metres.
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/path/path_smoothing.h"
#include "control/path/place_tracker.h"
#include "control/pd.h"
#include "control/tunnel_wall.h"
#include "player/guidance/guidance_controller.h"
#include "tests/extremes/support.h"

#include <fmt/format.h>
#include <memory>

namespace haptrace {
namespace {

using test::Log, test::Watched;

constexpr std::array kInterpolations{Interpolation::hold, Interpolation::linear, Interpolation::cubic,
                                     Interpolation::quintic};

/// Expects every trajectory through a path to be finite, close to the path, and exact at its samples.
void expect_trajectories(const Path& path) {
  const double extent = path.bounds().size().norm(), duration = path.duration();
  const double near = 1e-12 * (1 + path.bounds().max.cwiseAbs().maxCoeff());
  for (const Interpolation interpolation : kInterpolations) {
    SCOPED_TRACE(to_string(interpolation));
    const Trajectory trajectory(path, interpolation);
    Trajectory::Cursor cursor;
    for (int i = -3; i <= 403; ++i) {
      const Reference at = trajectory.sample(duration * i / 400, cursor);
      ASSERT_TRUE(is_finite(at.position) && is_finite(at.velocity) && is_finite(at.acceleration)) << i;
      ASSERT_LE((at.position - path.bounds().center()).norm(), 2 * extent + near) << i;
    }
    const std::size_t every = std::max<std::size_t>(path.size() / 500, 1);
    for (std::size_t i = 0; i < path.size(); i += every)
      ASSERT_LE((trajectory.sample(path.time[i] - path.time[0]).position - path.position[i]).norm(), near) << i;
  }
  const double tau = smoothing_time({&path, 1});
  ASSERT_TRUE(tau >= 0 && tau <= 0.05);
  for (const double time_constant : {tau, 1e-9, 0.05, 1.0})
    for (const Vec3& p : smooth_positions(path, time_constant))
      ASSERT_LE((p - path.bounds().center()).norm(), 2 * extent + near) << time_constant;
}

/// Expects guidance along a path to be finite and to keep its progress within the path.
void expect_guidance(const Path& path) {
  const double extent = path.bounds().size().norm();
  ArcPath::Builder builder(ArcPath::spacing_for(extent));
  for (std::size_t i = 0; i < path.size(); ++i) builder.add(path.time[i], path.position[i], Vec3(1, 0, 0));
  const auto arc = std::make_shared<const ArcPath>(builder.finish(1e-3));
  for (const double s : {-1., 0., 0.5 * arc->length(), arc->length(), 1e9}) {
    const ArcPath::Place place = arc->at(s);
    ASSERT_TRUE(is_finite(place.position) && is_finite(place.tangent) && is_finite(place.force)) << s;
    ASSERT_TRUE(std::isfinite(place.speed)) << s;
  }
  for (const bool cursor : {false, true}) {
    GuideTerms terms;
    terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
    terms.push_back(std::make_unique<ExpertForce>(1));
    terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{}));
    GuidanceController controller(
        arc, Guidance(std::move(terms), {}), cautious_gains(10, 1000),
        {.cursor = cursor, .hold = 0, .approach_speed = 2, .time_limit = 1, .max_deviation = 10});
    test::PointMass mass;
    mass.place(path.position.front() + Vec3(0, 1e-3, 0));
    Watched device(mass);
    Log log;
    const ServoReport report = test::run(device, controller, log);
    ASSERT_TRUE(report.cause == StopCause::finished) << report.detail;
    for (const Sample& row : log.samples) {
      ASSERT_TRUE(std::isnan(row.progress) || (row.progress >= 0 && row.progress <= arc->length())) << row.tick;
      ASSERT_TRUE(is_finite(row.reference_position)) << row.tick;
    }
  }
}

/// Expects a playback of a path to finish at its end.
void expect_playback(const Path& path, double speed) {
  PlaybackController controller(Trajectory(path, Interpolation::cubic), test::terms_of(std::make_unique<PdLaw>()),
                                {.gains = {Vec3::Constant(800), Vec3::Constant(10)}},
                                {.speed = speed, .hold = 0.2, .approach_speed = 2, .max_deviation = 10});
  test::PointMass mass;
  mass.place(path.position.front() + Vec3(1e-3, 0, 0));
  Watched device(mass);
  Log log;
  // Knots that are nanometres apart make the force vibrate. The path causes this, not the loop.
  EXPECT_EQ(test::run(device, controller, log, {.watch_vibration = false}).cause, StopCause::finished);
  EXPECT_LE((log.samples.back().reference_position - path.position.back()).norm(), 1e-9);
}

Path line(const std::vector<double>& time, const std::vector<double>& x) {
  Path path{.name = "line", .time = time};
  for (const double at : x) path.position.emplace_back(at, 0.5 * at, 0);
  return path;
}

TEST(Paths, RestWithoutLength) {
  for (const int rows : {1, 2, 3, 8, 5000}) {
    SCOPED_TRACE(fmt::format("{} rows", rows));
    Path path{.name = "rest"};
    for (int i = 0; i < rows; ++i) {
      path.time.push_back(5 + 1e-3 * i);
      path.position.emplace_back(0.03, -0.02, 0.01);
    }
    expect_trajectories(path);
    expect_guidance(path);
    expect_playback(path, 10);
    EXPECT_EQ(Trajectory(path, Interpolation::cubic).sample(1e-3).velocity, Vec3::Zero());
  }
}

TEST(Paths, AreFollowedWithOneAndTwoPoints) {
  for (const auto& path : {line({3}, {0.02}), line({3, 3.5}, {0, 0.05}), line({-1e9 + 1, -1e9 + 2}, {0.05, 0})}) {
    expect_trajectories(path);
    expect_guidance(path);
    expect_playback(path, 1);
  }
}

TEST(Paths, AreFollowedFromANanometreToTenMetres) {
  for (const double size : {1e-12, 1e-9, 1e-6, 1e-3, 0.1, 10.}) {
    SCOPED_TRACE(fmt::format("{} m", size));
    Path path = test::circle(0.06, 2);
    for (Vec3& p : path.position) p *= size / 0.06;
    for (Vec3& v : path.velocity) v *= size / 0.06;
    expect_trajectories(path);
    expect_guidance(path);
    expect_playback(path, 1);
  }
}

TEST(Paths, AreFollowedWithNanometresBesideTenMetres) {
  // Steps of a nanometre, of ten metres and of zero, in both directions and mixed.
  Path path{.name = "uneven"};
  double t = 0, x = 0;
  for (int i = 0; i < 300; ++i) {
    const double step = std::array{1e-9, 10.0, 0.0, -10.0, -1e-9, 1e-12}[static_cast<std::size_t>(i * 7 % 6)];
    t += std::abs(step) > 1 ? 5 : 1e-3;
    x += step;
    path.time.push_back(t);
    path.position.emplace_back(x, 0, i % 2 * 1e-9);
  }
  expect_trajectories(path);
  expect_guidance(path);
  expect_playback(path, 100);
}

TEST(Paths, AreFollowedWithStepsFromANanosecondToYears) {
  const Path path = line({0, 1e-9, 2e-9, 1e-3, 1, 1 + 1e-6, 3600, 1e8, 1e8 + 1, 1e9},
                         {0, 1e-9, 0, 1e-3, 0.05, 0.05, 0, 0.05, 0, 0.05});
  expect_trajectories(path);
  Trajectory::Cursor cursor;
  const Trajectory trajectory(path, Interpolation::quintic);
  for (double at = 1e-10; at < 2e9; at *= 1.1) {
    const Reference r = trajectory.sample(at, cursor);
    ASSERT_TRUE(is_finite(r.position) && is_finite(r.velocity) && is_finite(r.acceleration)) << at;
  }
}

/// A path of `rows` rows that are computed on demand: loops over a slow drift.
class EndlessLoops final : public PathSource {
 public:
  explicit EndlessLoops(std::uint64_t rows) {
    facts_.name = "loops";
    facts_.rows = rows;
    facts_.end = time_of(rows - 1);
    facts_.bounds = {Vec3(-0.11, -0.06, -0.02), Vec3(0.11, 0.06, 0.02)};
    facts_.peak_speed = 1;
    facts_.longest_interval = 1e-3;
  }
  static double time_of(std::uint64_t row) { return 1e-3 * static_cast<double>(row); }
  [[nodiscard]] Vec3 at(std::uint64_t row) const {
    const double part = static_cast<double>(row) / static_cast<double>(facts_.rows);
    const double phase = 2 * std::numbers::pi * 0.8 * time_of(row);
    return {0.05 * std::cos(phase) + 0.1 * (part - 0.5), 0.05 * std::sin(phase), 0.02 * std::sin(0.3 * phase)};
  }
  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    Path path{.name = facts_.name};
    for (std::uint64_t row = first; row < std::min(first + count, facts_.rows); ++row) {
      path.time.push_back(time_of(row));
      path.position.push_back(at(row));
    }
    return path;
  }
  [[nodiscard]] std::uint64_t row_at(double time) const override {
    return std::min(static_cast<std::uint64_t>(std::max(time * 1e3 + 0.5, 0.0)), facts_.rows - 1);
  }
};

TEST(Paths, AreFollowedThroughTenMillionPoints) {
  constexpr std::uint64_t kRows = 10'000'000;
  const auto source = std::make_shared<const EndlessLoops>(kRows);
  const TrajectoryPieces pieces(source, Interpolation::cubic);
  EXPECT_EQ(pieces.duration(), EndlessLoops::time_of(kRows - 1));
  // Sample a few pieces in order, from end to end and across their seams.
  for (const std::size_t index : {std::size_t{0}, std::size_t{1}, pieces.count() / 2, pieces.count() - 1}) {
    const TrajectoryPiece piece = pieces.make(index);
    Trajectory::Cursor cursor;
    const std::uint64_t first = source->row_at(piece.begin), last = source->row_at(piece.end);
    for (std::uint64_t row = first; row <= last; row += 7) {
      const Reference r = piece.trajectory.sample(EndlessLoops::time_of(row), cursor);
      ASSERT_LE((r.position - source->at(row)).norm(), 1e-12) << row;
      ASSERT_LE(r.velocity.norm(), 1) << row;
    }
  }
  // Sample the whole path through the stream, which reads ahead, faster than any playback.
  ReferenceStream stream(pieces, {}, 100);
  Reference reference;
  for (double t = 0; t < stream.duration(); t += 4.7) {
    stream.wait(t);
    ASSERT_EQ(stream.sample(t, reference), ReferenceStream::Answer::ready) << t;
    ASSERT_TRUE(is_finite(reference.position) && is_finite(reference.velocity)) << t;
  }
  // Follow it by its arc length: 2.5 km, in knots of 1 cm.
  ArcPath::Builder builder(1e-2);
  for (std::uint64_t row = 0; row < kRows; ++row)
    builder.add(EndlessLoops::time_of(row), source->at(row), Vec3::Zero());
  const ArcPath path = builder.finish(1e-3);
  EXPECT_GT(path.length(), 2000);
  PlaceTracker projection(path, {});
  projection.start(path.length() - 0.05);
  for (int i = 0; i < 300; ++i) {
    const double s = path.length() - 0.05 + 2e-4 * i;
    EXPECT_NEAR(projection.update(path.position_at(s), 1e-3).s, std::min(s, path.length()), 1e-9);
  }
}

}  // namespace
}  // namespace haptrace
