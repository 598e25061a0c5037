// A scene at a rate of its own: the forces between its updates, their errors, and the threads.
#include "scene/slow_scene.h"

#include "base/json_reader.h"
#include "control/path/path.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "player/record.h"
#include "player/record_controllers.h"
#include "scene/scene_controller.h"
#include "scene/scene_file.h"
#include "scene/surface/elastic.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <thread>

namespace haptrace {
namespace {

using std::numbers::pi;
using test::error_of;
using test::Log;
using test::PointMass;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kBallOnly = R"({"objects": [{"kind": "sphere", "radius": 0.03, "stiffness": 800}]})";
const std::string kWallOnly =
    R"({"objects": [{"kind": "wall", "point": [0, 0, 0.03], "normal": [0, 0, 1], "stiffness": 800, "damping": 3}]})";

std::shared_ptr<Scene> slow_test_scene(const std::string& json) {
  return read_scene(parse_json(json, "test"), "test");
}

/// Returns the touch of a hand that approaches from outside, presses and slides, in 0.6 s.
Touch touch_at(int tick) {
  const double t = 1e-3 * tick, w = 2 * pi / 0.3;
  return {.position = Vec3(0.004 * std::sin(w * t), 0, 0.0305 + 0.004 * std::cos(w * t)),
          .velocity = w * Vec3(0.004 * std::cos(w * t), 0, -0.004 * std::sin(w * t)),
          .dt = tick == 0 ? 0 : 1e-3};
}

TEST(SlowScene, ComputesAtEveryNthTickAndActsOnePeriodLater) {
  SlowScene slow(slow_test_scene(kBallOnly), {.rate_hz = 100}, 1000);
  const auto scene = slow_test_scene(kBallOnly);
  scene->prepare({.rate_hz = 100});
  slow.reset();
  int pushed = 0;
  for (int tick = 0; tick < 600; ++tick) {
    const Vec3 force = slow.answer(touch_at(tick)).force;
    slow.between_ticks(true);
    const int asked = tick / 10 * 10 - 10;
    const Vec3 expected = asked < 0 ? Vec3::Zero() : scene->answer(touch_at(asked)).force;
    ASSERT_EQ(force, expected) << tick;
    pushed += force.z() > 0 ? 1 : 0;
  }
  EXPECT_GT(pushed, 200);
}

TEST(SlowScene, IsTheWallItselfWhereAPlaneIsPredicted) {
  SlowScene slow(slow_test_scene(kWallOnly), {.rate_hz = 50, .prediction = Prediction::model}, 1000);
  const auto wall = slow_test_scene(kWallOnly);
  wall->prepare({});
  slow.reset();
  for (int tick = 0; tick < 600; ++tick) {
    const SceneAnswer predicted = slow.answer(touch_at(tick)), truth = wall->answer(touch_at(tick));
    slow.between_ticks(true);
    if (tick < 20) continue;
    ASSERT_LT((predicted.force - truth.force).norm(), 1e-12) << tick;
    ASSERT_NEAR(predicted.stored, truth.stored, 1e-12);
    ASSERT_EQ(predicted.contacts[0].touched(), truth.contacts[0].touched());
  }
}

TEST(SlowScene, NeverPullsAndNeverRunsAwayForAnyPrediction) {
  for (const Prediction prediction : {Prediction::hold, Prediction::linear, Prediction::model}) {
    SlowScene slow(slow_test_scene(kBallOnly), {.rate_hz = 50, .prediction = prediction}, 1000);
    const auto scene = slow_test_scene(kBallOnly);
    scene->prepare({});
    slow.reset();
    double most = 0;
    int more_than_held = 0;
    for (int tick = 0; tick < 600; ++tick) {
      const SceneAnswer answer = slow.answer(touch_at(tick));
      slow.between_ticks(true);
      const Contact contact = answer.contacts.empty() ? Contact{} : answer.contacts[0];
      ASSERT_GE(contact.force.dot(contact.normal), -1e-12);
      const int asked = tick / 20 * 20 - 20;
      const double held = asked < 0 ? 0 : scene->answer(touch_at(asked)).force.norm();
      ASSERT_TRUE(prediction != Prediction::linear || contact.force.norm() <= 1.5 * held + 1e-12);
      more_than_held += contact.force.norm() > held + 1e-9 ? 1 : 0;
      most = std::max(most, contact.force.norm());
    }
    EXPECT_LT(most, 2 * 800 * 0.0035 + 0.2);
    EXPECT_EQ(more_than_held > 50, prediction != Prediction::hold) << to_string(prediction);
  }
}

TEST(SlowScene, AllocatesNothingInTheTickAndForgetsAnswersFromBeforeAReset) {
  for (const Prediction prediction : {Prediction::hold, Prediction::linear, Prediction::model}) {
    const auto scene = slow_test_scene(kBallOnly);
    scene->set("sphere.renew", 0.003);  // gives the scene a state to forget
    SlowScene slow(scene, {.rate_hz = 100, .prediction = prediction}, 1000);
    std::vector<Vec3> first, second;
    first.reserve(300);
    second.reserve(300);
    for (auto* forces : {&first, &second}) {
      slow.reset();
      for (int tick = 0; tick < 300; ++tick) {
        const std::size_t before = test::allocations();
        forces->push_back(slow.answer(touch_at(tick)).force);
        ASSERT_EQ(test::allocations(), before);
        slow.between_ticks(true);
      }
    }
    EXPECT_EQ(first, second);
  }
}

/// A shape that blocks while a flag is set, and holds the tool everywhere.
class Stalling final : public Shape {
 public:
  explicit Stalling(std::shared_ptr<std::atomic<bool>> stalls) : stalls_(std::move(stalls)) {}
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override {
    while (*stalls_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    proxy = {.position = step.to + 1e-3 * Vec3::UnitZ(),
             .normal = Vec3::UnitZ(),
             .depth = 1e-3,
             .known = true,
             .touching = true};
  }
  [[nodiscard]] SurfacePoint nearest(const Vec3&) const noexcept override { return {}; }
  [[nodiscard]] Box bounds() const noexcept override { return {Vec3::Constant(-1), Vec3::Constant(1)}; }
  [[nodiscard]] TriangleMesh tessellated(double, const Box&) const override { return {}; }

 private:
  std::shared_ptr<std::atomic<bool>> stalls_;
};

TEST(SlowScene, DropsAStaleAnswerAndReportsIt) {
  const auto stalls = std::make_shared<std::atomic<bool>>(false);
  std::vector<std::unique_ptr<Object>> objects;
  objects.push_back(make_fixed_object("stalling", "stalling", std::make_unique<Stalling>(stalls),
                                      std::make_unique<ElasticSurface>(ElasticSpec{.stiffness = 1000})));
  SlowScene slow(std::make_shared<Scene>(std::move(objects)), {.rate_hz = 100}, 1000);
  slow.reset();
  int tick = 0;
  const auto force = [&] {
    const double z = slow.answer(touch_at(tick++)).force.z();
    slow.between_ticks(false);
    return z;
  };
  while (force() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  *stalls = true;
  int held = 0;
  while (held < 1000 && force() == 1) ++held;
  EXPECT_GE(held, 90);
  EXPECT_LE(held, 120);
  EXPECT_EQ(force(), 0);
  *stalls = false;
  while (force() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  slow.reset();
  EXPECT_EQ(force(), 0) << "what was answered before a reset is not used after it";
  EXPECT_THAT(testing::PrintToString(slow.remarks()),
              AllOf(HasSubstr("did not keep its rate"), HasSubstr("10 periods old")));
}

TEST(SlowScene, RejectsInvalidRatesAndPredictions) {
  const auto scene = slow_test_scene(kBallOnly);
  EXPECT_THAT(error_of([&] { SlowScene(scene, {.rate_hz = 1001}, 1000); }), HasSubstr("from 0.1 to 1000 Hz"));
  EXPECT_THAT(error_of([&] { SlowScene(scene, {.rate_hz = 0}, 1000); }), HasSubstr("from 0.1"));
  EXPECT_EQ(SlowScene::ticks_between(300, 1000), 3);
  EXPECT_EQ(parse_prediction("linear"), Prediction::linear);
  EXPECT_THAT(error_of([] { parse_prediction("modle"); }), HasSubstr("did you mean 'model'?"));
}

/// Forces of a slow scene on a hand, on a simulated device in virtual time.
struct Felt {
  double rms_error = 0;  ///< Rms error relative to the scene at the servo rate, at the same positions [N].
  double rms_force = 0;  ///< Rms force of the scene at the servo rate [N].
  double given = 0;      ///< Energy given to the hand [J].
  std::vector<Sample> rows;
};

/// Returns the device string of a simulated hand that comes from 5 mm outside and presses 5 mm deep, four times in 4 s,
/// while it slides 10 mm to and fro.
std::string pressing_hand(const TempFolder& folder) {
  std::string csv = "t,x,y,z\n";
  for (int i = 0; i <= 400; ++i) {
    const double t = 0.01 * i;
    csv += fmt::format("{},{},0,{}\n", t, 0.005 * std::sin(pi * t), 0.03 + 0.005 * std::cos(2 * pi * t));
  }
  return "sim:preset=omega3,hand=firm,seed=1,intent=" + folder.write("press.csv", csv);
}

Felt feel(const std::string& scene, const std::string& hand, std::optional<SlowSceneOptions> slow) {
  const auto device = open_device(hand);
  const auto controller = make_scene_controller(slow_test_scene(scene), 1000, slow);
  TimedController timed(*controller, 4);
  Log log;
  SampleSink* const sinks[] = {&log};
  SessionOptions options;
  options.loop.limits.soft_start = 0;
  const SessionResult result = run_session(*device, timed, {}, sinks, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished) << result.servo.detail;

  Felt felt{.rows = std::move(log.samples)};
  const auto exact = slow_test_scene(scene);
  exact->prepare({});
  exact->reset();
  double error = 0, force = 0;
  int n = 0;
  for (std::size_t i = 0; i + 1 < felt.rows.size() && felt.rows[i].phase == Phase::idle; ++i, ++n) {
    const Sample& row = felt.rows[i];
    const Vec3 truth = exact->answer({row.position, row.velocity, i == 0 ? 0 : 1e-3}).force;
    error += (row.force - truth).squaredNorm();
    force += truth.squaredNorm();
    felt.given += row.force.dot(felt.rows[i + 1].position - row.position);
  }
  felt.rms_error = std::sqrt(error / n);
  felt.rms_force = std::sqrt(force / n);
  return felt;
}

/// With HAPTRACE_TABLE in the environment, the test prints the table of docs/scene.md.
TEST(SlowSceneInAHand, ErrsLessWithALineThanHeldAndLeastWithAPlane) {
  const TempFolder folder;
  const std::string hand = pressing_hand(folder);
  const bool prints = std::getenv("HAPTRACE_TABLE") != nullptr;
  for (const auto& [name, scene] : {std::pair{"sphere", kBallOnly}, std::pair{"wall", kWallOnly}}) {
    const Felt full = feel(scene, hand, std::nullopt);
    EXPECT_EQ(full.rms_error, 0);
    if (prints) std::printf("| %s | 1000 | | 0 | %.2f |\n", name, 1e3 * full.given);
    for (const double rate : {100.0, 50.0}) {
      std::vector<double> errors;
      for (const Prediction prediction : {Prediction::hold, Prediction::linear, Prediction::model}) {
        const Felt felt = feel(scene, hand, SlowSceneOptions{.rate_hz = rate, .prediction = prediction});
        errors.push_back(felt.rms_error);
        if (prints)
          std::printf("| %s | %.0f | %s | %.3f of %.3f | %.2f |\n", name, rate, to_string(prediction), felt.rms_error,
                      felt.rms_force, 1e3 * felt.given);
      }
      EXPECT_LT(errors[1], errors[0]) << name << ' ' << rate;
      EXPECT_LT(errors[2], 0.2 * errors[1]) << name << ' ' << rate;
    }
  }
}

TEST(SlowSceneInAHand, IsTheSameToTheLastBitInVirtualTime) {
  const TempFolder folder;
  const std::string hand = pressing_hand(folder);
  const SlowSceneOptions slow{.rate_hz = 70, .prediction = Prediction::linear};
  const Felt once = feel(kBallOnly, hand, slow), again = feel(kBallOnly, hand, slow);
  ASSERT_EQ(once.rows.size(), again.rows.size());
  for (std::size_t i = 0; i < once.rows.size(); ++i) {
    ASSERT_EQ(once.rows[i].force, again.rows[i].force);
    ASSERT_EQ(once.rows[i].position, again.rows[i].position);
  }
}

TEST(SlowSceneInAHand, ServesADeviceInRealTime) {
  PointMass device;
  device.mutable_info().virtual_time = false;
  device.place({0, 0, 0.031});
  device.throw_at({0, 0, -0.1});
  RecordOptions options{.duration = 0.3};
  options.session.touch.scene = slow_test_scene(kBallOnly);
  options.session.touch.slow = SlowSceneOptions{.rate_hz = 100, .prediction = Prediction::model};
  options.session.loop.limits.soft_start = 0;
  const SessionResult result = record(device, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished);
  EXPECT_FALSE(result.virtual_time);
  ASSERT_EQ(result.touches.size(), 1U);
  EXPECT_EQ(result.touches[0].times, 1);
  EXPECT_NEAR(result.touches[0].max_force, 800 * result.touches[0].max_depth, 1e-9);
}

}  // namespace
}  // namespace haptrace
