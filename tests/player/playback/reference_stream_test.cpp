#include "player/playback/reference_stream.h"

#include "control/path/shapes.h"
#include "formats/path/path_file.h"
#include "player/playback/playback.h"
#include "player/playback/playback_controller.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <chrono>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <thread>

namespace haptrace {
namespace {

using testing::HasSubstr;

constexpr TrajectoryPieces::Options kSmallPieces{.rows = 300, .undivided = 1};

/// A kind of movement with many frequencies: sampled every 1 ms or at steps that differ up to 1 : 5, and without
/// velocities or with true or useless ones.
struct Kind {
  std::string name;
  bool even, velocity, useless;
};

Path wandering(const Kind& kind, unsigned seed, std::size_t rows) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> number(-1, 1);
  std::array<Vec3, 12> amplitude;
  std::array<double, 12> frequency{};
  for (std::size_t k = 0; k < amplitude.size(); ++k) {
    amplitude[k] = 0.01 * Vec3(number(random), number(random), number(random));
    frequency[k] = 20 * (1 + number(random));
  }
  Path path{.name = "wandering"};
  double t = 12.5;
  for (std::size_t i = 0; i < rows; ++i) {
    Vec3 p = Vec3::Zero(), v = Vec3::Zero();
    for (std::size_t k = 0; k < amplitude.size(); ++k) {
      p += amplitude[k] * std::sin(frequency[k] * t);
      v += amplitude[k] * frequency[k] * std::cos(frequency[k] * t);
    }
    path.time.push_back(t);
    path.position.push_back(p);
    if (kind.velocity) path.velocity.push_back(kind.useless ? Vec3(-3 * v) : v);
    t += kind.even ? 1e-3 : 1e-3 * (1 + 0.66 * number(random));
  }
  return path;
}

class ReferenceStreamLaws : public testing::TestWithParam<std::tuple<Interpolation, Kind>> {};

TEST_P(ReferenceStreamLaws, AnswersAsTheTrajectoryOfTheWholePathForwardAndFromTheStartAgain) {
  const auto& [interpolation, kind] = GetParam();
  for (const unsigned seed : {1U, 2U}) {
    const Path path = wandering(kind, seed, 3000);
    const Trajectory whole(path, interpolation);
    const TrajectoryPieces pieces(source_of(path), interpolation, kSmallPieces);
    ASSERT_EQ(pieces.count(), 10U);
    ReferenceStream stream(pieces, {});
    ASSERT_EQ(stream.duration(), whole.duration());
    std::mt19937 random(seed);
    std::exponential_distribution<double> step(500);
    for (int repetition = 0; repetition < 3; ++repetition)
      for (double t = 0; t < whole.duration() + 0.1; t += step(random)) {
        stream.wait(t);
        Reference reference;
        ASSERT_EQ(stream.sample(t, reference), ReferenceStream::Answer::ready) << t;
        const Reference expected = whole.sample(t);
        ASSERT_LE((reference.position - expected.position).norm(), 1e-12) << t;
        ASSERT_LE((reference.velocity - expected.velocity).norm(), 1e-12 * (1 + expected.velocity.norm()) / 1e-3) << t;
        ASSERT_LE((reference.acceleration - expected.acceleration).norm(),
                  1e-12 * (1 + expected.acceleration.norm()) / 1e-6)
            << t;
      }
  }
}

TEST_P(ReferenceStreamLaws, AllocatesNothingInTheThreadThatAsksAlsoFromPieceToPiece) {
  const auto& [interpolation, kind] = GetParam();
  const TrajectoryPieces pieces(source_of(wandering(kind, 3, 3000)), interpolation, kSmallPieces);
  ReferenceStream stream(pieces, {});
  Reference reference;
  std::size_t allocated = 0;
  for (double t = 0; t < stream.duration(); t += 1e-3) {
    stream.wait(t);
    const std::size_t before = test::allocations();
    ASSERT_EQ(stream.sample(t, reference), ReferenceStream::Answer::ready);
    allocated += test::allocations() - before;
  }
  EXPECT_EQ(allocated, 0U);
}

INSTANTIATE_TEST_SUITE_P(
    All, ReferenceStreamLaws,
    testing::Combine(
        testing::Values(Interpolation::hold, Interpolation::linear, Interpolation::cubic, Interpolation::quintic),
        testing::Values(Kind{"Even", true, false, false}, Kind{"Uneven", false, false, false},
                        Kind{"WithVelocity", false, true, false}, Kind{"WithUselessVelocity", true, true, true})),
    [](const auto& tested) { return to_string(std::get<0>(tested.param)) + std::get<1>(tested.param).name; });

TEST(ReferenceStream, SmoothsANoisyPathInPiecesAsInOne) {
  Path path = wandering({.name = "", .even = false, .velocity = true, .useless = false}, 1, 5000);
  for (Vec3& p : path.position) p = 5e-5 * (p / 5e-5).array().round().matrix();
  const TrajectoryPieces whole(source_of(path), Interpolation::cubic);
  EXPECT_EQ(whole.count(), 1U);
  EXPECT_GT(whole.smoothing(), 1e-3);
  const TrajectoryPieces pieces(source_of(path), Interpolation::cubic, {.rows = 300, .undivided = 1});
  EXPECT_EQ(pieces.count(), 17U);
  EXPECT_EQ(pieces.smoothing(), whole.smoothing()) << "as short a path is judged by all of it";
  EXPECT_EQ(TrajectoryPieces(source_of(path), Interpolation::cubic, {.smoothing = 0}).smoothing(), 0);
  EXPECT_EQ(TrajectoryPieces(source_of(path), Interpolation::linear).smoothing(), 0) << "nothing to differentiate";
  ReferenceStream one(whole, {}), many(pieces, {});
  Vec3 before = Vec3::Zero();
  for (double t = 0; t < one.duration(); t += 1e-3) {
    many.wait(t);
    Reference expected, reference;
    ASSERT_EQ(one.sample(t, expected), ReferenceStream::Answer::ready);
    ASSERT_EQ(many.sample(t, reference), ReferenceStream::Answer::ready);
    ASSERT_LT((reference.position - expected.position).norm(), 1e-9) << t;
    ASSERT_LT((reference.velocity - expected.velocity).norm(), 1e-6) << t;
    ASSERT_LT((reference.acceleration - expected.acceleration).norm(), 1e-2) << t;
    // The movement changes the acceleration by at most 12 * 0.017 * 40^3 / 1000 = 13 m/s^2 per millisecond.
    const bool inside = t > 0.1 && t < one.duration() - 0.1;  // the path neither starts nor ends at rest
    ASSERT_LT((reference.acceleration - before).norm(), inside ? 20 : 1e3) << t;
    before = reference.acceleration;
  }
}

/// A path whose rows from `gate` on block until the gate opens, or are damaged.
class Gated final : public PathSource {
 public:
  Gated(const Path& path, std::uint64_t gate, bool broken) : path_(source_of(path)), gate_(gate), broken_(broken) {
    facts_ = path_->facts();
    blocks_ = path_->blocks();
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    if (armed && first + count > gate_) {
      if (broken_) throw input_error("row 1200 is damaged");
      open.wait(false);
    }
    return path_->read(first, count);
  }
  [[nodiscard]] std::uint64_t row_at(double time) const override { return path_->row_at(time); }

  std::atomic<bool> armed{false}, open{false};

 private:
  std::unique_ptr<PathSource> path_;
  std::uint64_t gate_;
  bool broken_;
};

const Kind kPlain{"Even", true, false, false};

/// Runs a controller with a hand at the previous reference.
class Follower {
 public:
  explicit Follower(ReferenceStream stream) : controller_(std::move(stream), {}, {}, {}) {}

  Command tick(bool may_wait) {
    if (first_) controller_.start(state_);
    state_.dt = first_ ? 0 : 1e-3;
    first_ = false;
    Command command = controller_.update(state_);
    state_.position = command.reference.position;
    controller_.between_ticks(may_wait);
    return command;
  }

 private:
  PlaybackController controller_;
  State state_;
  bool first_ = true;
};

TEST(Playback, HoldsItsReferenceWhileThePathIsNotReadAndResumesWithoutAJump) {
  const Path path = wandering(kPlain, 4, 3000);
  const auto source = std::make_shared<Gated>(path, 1200, false);
  const TrajectoryPieces pieces(source, Interpolation::cubic, kSmallPieces);
  source->armed = true;
  Follower follower(ReferenceStream(pieces, {}));
  const double farthest = 1.1e-3 * source->facts().peak_speed;  // distance per tick [m]
  Vec3 before = Vec3::Zero();
  int held = 0, told = 0, ticks = 0;
  bool waits = false;
  Command command;
  for (; command.status == Command::Status::working; ++ticks) {
    ASSERT_LT(ticks, 100'000);
    // Ticks as fast as possible without waiting; the gate opens after the reference has waited for a while.
    command = follower.tick(false);
    ASSERT_TRUE(is_finite(command.reference.position));
    const double step = (command.reference.position - before).norm();
    if (command.event && command.event->code == EventCode::path_waits) {
      EXPECT_FALSE(waits) << "once for every time it waits";
      ++told;
      waits = true;
    }
    if (waits && step == 0) {
      EXPECT_EQ(command.reference.velocity, Vec3::Zero());
      if (++held == 500) {
        source->open = true;
        source->open.notify_all();
      }
      if (held > 500) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    } else if (command.phase == Phase::run) {
      ASSERT_LE(step, waits ? 0.05 * farthest : farthest) << "from where it waited, and gently";
      waits = false;
    }
    before = command.reference.position;
  }
  EXPECT_GE(held, 500);
  EXPECT_GE(told, 1);
  EXPECT_EQ(command.status, Command::Status::finished);
  EXPECT_LE((before - path.position.back()).norm(), 1e-12);
}

TEST(Playback, WaitsForThePathBetweenTicksWhereTimeStandsStill) {
  const Path path = wandering(kPlain, 5, 3000);
  const auto source = std::make_shared<Gated>(path, 1200, false);
  const TrajectoryPieces pieces(source, Interpolation::cubic, kSmallPieces);
  source->armed = true;
  std::jthread opener([source] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    source->open = true;
    source->open.notify_all();
  });
  Follower slow(ReferenceStream(pieces, {})), fast(Trajectory(path, Interpolation::cubic));
  for (Command command; command.status == Command::Status::working;) {
    command = slow.tick(true);
    ASSERT_FALSE(command.event && command.event->code == EventCode::path_waits);
    const Command expected = fast.tick(true);
    ASSERT_LE((command.reference.position - expected.reference.position).norm(), 1e-12);
    ASSERT_EQ(command.status, expected.status);
  }
}

TEST(Playback, StopsSafelyWhereThePathCannotBeRead) {
  const Path path = wandering(kPlain, 6, 200'000);
  const auto source = std::make_shared<Gated>(path, 100'000, true);
  test::PointMass device;
  device.mutable_info().max_continuous_force = device.info().max_force;
  PlayOptions options;
  options.gains = PdGains{Vec3::Constant(800), Vec3::Constant(12)};
  options.playback.max_deviation = 1;
  const PlayPlan plan = plan_playback(device.info(), source, options);
  source->armed = true;
  const PlayResult result = play(device, plan, options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::no_path);
  EXPECT_TRUE(result.session.servo.stopped_by_fault());
  EXPECT_THAT(result.session.servo.detail,
              testing::AllOf(HasSubstr("cannot be played beyond 98.304 s"), HasSubstr("row 1200 is damaged")));
  EXPECT_EQ(device.forces().back(), Vec3::Zero());
  EXPECT_EQ(to_json(result)["stopped_by"], "no_path");
}

TEST(Playback, StopsBeforeAPieceThatLeavesTheWorkspaceOrIsTooFast) {
  Path path = wandering(kPlain, 7, 200'000);
  /// A path that turns bad after planning, like a file that changes.
  struct Turning final : PathSource {
    explicit Turning(const Path& path) : path_(source_of(path)) {
      facts_ = path_->facts();
      blocks_ = path_->blocks();
    }
    [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
      Path piece = path_->read(first, count);
      if (bad)
        for (std::size_t i = 0; i < piece.size(); ++i)
          if (first + i >= 120'000) piece.position[i] *= scale;
      return piece;
    }
    [[nodiscard]] std::uint64_t row_at(double time) const override { return path_->row_at(time); }
    std::atomic<bool> bad{false};
    double scale = 1;
    std::unique_ptr<PathSource> path_;
  };
  for (const auto& [scale, said] :
       {std::pair{30.0, "leaves the workspace of point mass by"}, {2.0, "above the velocity limit"}}) {
    const auto source = std::make_shared<Turning>(path);
    source->scale = scale;
    test::PointMass device;
    device.mutable_info().max_continuous_force = device.info().max_force;
    PlayOptions options;
    options.gains = PdGains{Vec3::Constant(800), Vec3::Constant(12)};
    options.playback.max_deviation = 1;
    options.session.loop.limits.max_velocity = 1.2 * plan_playback(device.info(), source, options).peak_speed;
    const PlayPlan plan = plan_playback(device.info(), source, options);
    source->bad = true;
    const PlayResult result = play(device, plan, options, StopRequest{});
    EXPECT_EQ(result.session.servo.cause, StopCause::no_path);
    EXPECT_THAT(result.session.servo.detail, HasSubstr(said));
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
  }
}

TEST(Playback, RepeatsALongPathWithoutWaiting) {
  const TrajectoryPieces pieces(source_of(wandering(kPlain, 8, 3000)), Interpolation::linear, kSmallPieces);
  test::PointMass device;
  test::Log log;
  PlaybackController controller(ReferenceStream(pieces, {}), {}, {},
                                {.repetitions = 3, .hold = 0, .max_deviation = 10});
  SampleSink* const sinks[] = {&log};
  const SessionResult result = run_session(device, controller, {.reference = true}, sinks, {}, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished);
  EXPECT_FALSE(log.has(EventCode::path_waits));
  const auto runs = std::count_if(log.events.begin(), log.events.end(),
                                  [](const Event& event) { return event.code == EventCode::repetition; });
  EXPECT_EQ(runs, 3);
}

/// Peak memory of the process since reset() [MiB].
class PeakMemory {
 public:
  static void reset() { std::ofstream("/proc/self/clear_refs") << "5"; }
  static double now(const std::string& key = "VmHWM:") {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
      if (double kib = 0; word == key && status >> kib) return kib / 1024;
    return std::numeric_limits<double>::quiet_NaN();
  }
};

/// Writes a recording of a circular movement at 1 kHz.
void record_circle(const std::string& file, std::size_t rows) {
  RecordingWriter writer(file, {}, {}, {});
  std::vector<Sample> block(8192);
  for (std::size_t first = 0; first < rows; first += block.size()) {
    block.resize(std::min(block.size(), rows - first));
    for (std::size_t i = 0; i < block.size(); ++i) {
      const double t = 1e-3 * static_cast<double>(first + i);
      block[i].tick = first + i;
      block[i].time_ns = static_cast<std::int64_t>(first + i) * 1'000'000;
      block[i].position = 0.05 * Vec3(std::cos(t), std::sin(t), 0);
      block[i].velocity = 0.05 * Vec3(-std::sin(t), std::cos(t), 0);
    }
    writer.append(block);
  }
  writer.finish();
}

/// Returns the memory for opening a recording and sampling five minutes of its reference from `from` [s] on [MiB].
double memory_of_playing(const std::string& file, double from) {
  PeakMemory::reset();
  const double before = PeakMemory::now("VmRSS:");
  test::PointMass device;
  const PlayPlan plan = plan_playback(device.info(), open_path(file, {.from = from}), {});
  ReferenceStream stream(*plan.path, {});
  Reference reference;
  for (double t = 0; t < std::min(300.0, stream.duration()); t += 1e-2) {
    stream.wait(t);
    EXPECT_EQ(stream.sample(t, reference), ReferenceStream::Answer::ready);
    EXPECT_LE((reference.position - 0.05 * Vec3(std::cos(from + t), std::sin(from + t), 0)).norm(), 1e-9);
  }
  return PeakMemory::now() - before;
}

TEST(Playback, TakesTheSameMemoryWhateverTheLengthOfTheRecording) {
  const test::TempFolder folder;
  record_circle(folder / "short.h5", 400'000);
  record_circle(folder / "long.h5", 2'000'000);
  (void)memory_of_playing(folder / "short.h5", 50);  // allocations that occur only once
  const double once = memory_of_playing(folder / "short.h5", 50), more = memory_of_playing(folder / "long.h5", 1000);
  EXPECT_LT(more, once + 8) << "a million rows of a path are 56 MB";
}

}  // namespace
}  // namespace haptrace
