// Objects that are felt all through a volume: the laws that apply to them.
#include "scene/field_object.h"

#include "tests/scene/alone.h"
#include "tests/scene/volumes.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::Alone;
using test::error_of;
using test::scene_with;
using test::volume_of;
using testing::HasSubstr;

constexpr double kFieldTick = 1e-3;  // [s]

/// Returns the name of a file with smooth values from -1 to 1, 2 mm a sample, 78 mm wide.
const std::string& waves_file() {
  static const std::string file = test::volume_file(
      "waves.nrrd", volume_of(
                        [](const Vec3& p) {
                          return std::sin(120 * p.x() + 1) * std::cos(90 * p.y()) * std::cos(70 * p.z() + 60 * p.x());
                        },
                        40, 2e-3));
  return file;
}

struct FieldCase {
  std::string name, field, pose;
  bool elastic = true;  ///< without drag
};

void PrintTo(const FieldCase& field, std::ostream* out) {
  *out << field.name;
}

class FieldLaws : public testing::TestWithParam<FieldCase> {
 protected:
  [[nodiscard]] static std::string json() {
    const std::string pose = GetParam().pose.empty() ? "" : R"(, "pose": )" + GetParam().pose;
    return fmt::format(R"({{"kind": "volume", "file": "{}", "iso": 0.1, "field": {}{}}})", waves_file(),
                       GetParam().field, pose);
  }
  [[nodiscard]] static std::vector<Touch> walk(unsigned seed, int ticks) {
    std::mt19937 random(seed);
    std::normal_distribution<double> push;
    std::vector<Touch> touches;
    Touch touch;
    for (int i = 0; i < ticks; ++i) {
      touch.velocity += kFieldTick * (40 * Vec3(push(random), push(random), push(random)) - 30 * touch.position) -
                        0.01 * touch.velocity;
      touch.position += kFieldTick * touch.velocity;
      touches.push_back(touch);
      touch.dt = kFieldTick;
    }
    return touches;
  }
  static constexpr double kHalf = 0.039;
  /// Returns whether a place is in the grid, in the frame of the object.
  [[nodiscard]] static bool in_grid(const Alone& field, const Vec3& place) {
    return field.object().pose().place_of(place).cwiseAbs().maxCoeff() < kHalf;
  }
};

TEST_P(FieldLaws, HasNoForceOutsideAndIsBoundedInside) {
  Alone field(json());
  int outside = 0, felt = 0;
  double most = 0;
  for (const Touch& touch : walk(1, 20'000)) {
    const Contact contact = field.answer(touch);
    ASSERT_TRUE(is_finite(contact.force));
    ASSERT_GE(contact.stored, 0);
    if (!in_grid(field, touch.position)) {
      ++outside;
      ASSERT_EQ(contact.force, Vec3::Zero());
      ASSERT_EQ(contact.stored, 0);
      ASSERT_FALSE(contact.touched());
    } else if (contact.force.norm() > 0) {
      ++felt;
      most = std::max(most, contact.force.norm());
    }
  }
  EXPECT_GT(outside, 100);
  EXPECT_GT(felt, 2000);
  EXPECT_LT(most, 60);
  for (const double far : {0.0391, 1.0, 1e8})
    EXPECT_EQ(field.answer({field.object().pose().position + Vec3(0, 0, 2 * far)}).force, Vec3::Zero());
}

TEST_P(FieldLaws, IsTheGradientOfItsEnergyAndStatesItsStiffness) {
  Alone field(json());
  std::mt19937 random(2);
  std::uniform_real_distribution<double> side(-0.04, 0.04);
  int felt = 0;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 place = field.object().pose().position + Vec3(side(random), side(random), side(random));
    const Contact contact = field.answer({.position = place});
    constexpr double kStep = 1e-6;
    Vec3 slope;
    for (int axis = 0; axis < 3; ++axis)
      slope[axis] = (field.answer({.position = place + kStep * Vec3::Unit(axis)}).stored -
                     field.answer({.position = place - kStep * Vec3::Unit(axis)}).stored) /
                    (2 * kStep);
    ASSERT_LT((contact.force + slope).norm(), 1e-4 * (1 + contact.force.norm()));
    if (!(contact.force.norm() > 0.1)) continue;
    ++felt;
    ASSERT_LT((contact.force - contact.stiffness * contact.depth * contact.normal).norm(), 1e-9);
    ASSERT_LE(contact.depth, 0.01 * (1 + 1e-12));
    const Vec3 ahead = field.answer({.position = place + kStep * contact.normal}).force,
               behind = field.answer({.position = place - kStep * contact.normal}).force;
    const double stiffness = -(ahead - behind).dot(contact.normal) / (2 * kStep);
    if (contact.depth < 0.00999 && std::abs(stiffness - contact.stiffness) > 1e-2 * contact.stiffness) {
      // Where a point of the transfer function lies within the step, the quotient is between the two sides' stiffness.
      const double one = -(ahead - contact.force).dot(contact.normal) / kStep,
                   other = -(contact.force - behind).dot(contact.normal) / kStep;
      ASSERT_GT(std::abs(one - other), 1e-3 * contact.stiffness);
    }
  }
  if (GetParam().name != "Drag") {
    EXPECT_GT(felt, 300);
  }
}

TEST_P(FieldLaws, GivesNoEnergyRoundAClosedPath) {
  Alone field(json());
  double given = 0, work = 0;
  Vec3 last, before;
  constexpr int kSteps = 40'000;
  for (int i = 0; i <= kSteps; ++i) {
    const double a = 2 * std::numbers::pi * i / kSteps;
    const Vec3 place =
        field.object().pose().position + Vec3(0.03 * std::cos(3 * a), 0.045 * std::sin(a), 0.02 * std::sin(2 * a));
    const Vec3 force =
        field.answer({place, i == 0 ? Vec3::Zero() : Vec3((place - last) / kFieldTick), kFieldTick}).force;
    if (i > 0) {
      const double done = 0.5 * (force + before).dot(place - last);
      given += done;
      work += std::abs(done);
    }
    last = place;
    before = force;
  }
  EXPECT_GT(work, 1e-3);
  EXPECT_LT(given, 1e-4 * work);
  if (GetParam().elastic) {
    EXPECT_GT(given, -1e-4 * work);
  } else {
    EXPECT_LT(given, -0.1 * work) << "drag takes energy";
  }
}

TEST_P(FieldLaws, DoesNotJumpFromStepToStep) {
  Alone field(json());
  Vec3 last = Vec3::Zero();
  double worst = 0;
  for (int i = 0; i < 100'000; ++i) {
    const Vec3 place = field.object().pose().position + (1e-6 * i - 0.05) * Vec3(1, 0.7, 0.4);
    const Vec3 force = field.answer({place, Vec3(0.1, 0, 0), 0}).force;
    worst = std::max(worst, (force - last).norm());
    last = force;
  }
  EXPECT_GT(worst, 0);
  EXPECT_LT(worst, 0.02) << "of a micrometre";
}

TEST_P(FieldLaws, ForgetsAndAllocatesNothingAndIgnoresWhatIsNotValid) {
  Alone field(json()), fresh(json());
  const auto touches = walk(3, 500);
  const std::size_t before = test::allocations();
  Vec3 sum = Vec3::Zero();
  for (const Touch& touch : touches) sum += field.scene().answer(touch).force;
  EXPECT_EQ(test::allocations(), before);
  EXPECT_GT(sum.norm(), 0);
  field.reset();
  for (const Touch& touch : touches) {
    ASSERT_TRUE(field.scene().answer({.position = nan3()}).contacts.empty());
    ASSERT_EQ(field.scene().answer({.position = Vec3::Constant(1e300)}).force, Vec3::Zero());
    ASSERT_EQ(field.answer(touch).force, fresh.answer(touch).force);
  }
}

TEST_P(FieldLaws, GrowsSoftlyIfTheToolBeginsInside) {
  Alone settled(json());
  const auto scene = scene_with(json());
  scene->prepare({});
  Touch touch{settled.object().pose().position, Vec3(0.05, 0.02, 0), kFieldTick};
  while (!(settled.answer(touch).force.norm() > 0.1)) touch.position.x() += 1e-3;
  const Vec3 whole = settled.answer(touch).force;
  ASSERT_GT(whole.norm(), 0.01);
  EXPECT_FALSE(settled.answer(touch).pushed_out);
  const SceneAnswer first = scene->answer(touch);
  EXPECT_TRUE(first.contacts[0].pushed_out);
  EXPECT_EQ(first.force, Vec3::Zero());
  Vec3 last = first.force;
  for (int i = 0; i < 600; ++i) {
    const Vec3 force = scene->answer(touch).force;
    ASSERT_LE((force - last).norm(), 0.0021 * whole.norm());
    last = force;
  }
  EXPECT_LT((last - whole).norm(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(
    All, FieldLaws,
    testing::Values(FieldCase{"Energy", R"({"energy": [[-0.6, 0], [0, 0.01], [0.5, 0.02], [0.8, 0.005]]})", "", true},
                    FieldCase{"Drag", R"({"drag": [[-0.8, 1], [0, 4], [0.7, 9]]})", "", false},
                    FieldCase{"EnergyAndDrag",
                              R"({"energy": [[-0.2, 0], [0.3, 0.015]], "drag": [[-0.2, 5], [0.3, 9]]})",
                              R"({"position": [0.01, 0.02, -0.03], "rotation": [1, 0.5, -0.2, 0.7]})", false}));

TEST(TransferFunction, PassesThroughItsPointsWithoutOvershootAndWithAContinuousSlope) {
  const std::vector<TransferFunction::Point> points{{-3, 1}, {-1, 1}, {0, 4}, {0.1, 9}, {5, 2}, {6, 2.5}};
  const TransferFunction f(points);
  for (const auto& point : points) EXPECT_NEAR(f(point.at).value, point.value, 1e-12);
  EXPECT_EQ(f(-1e30).value, 1);
  EXPECT_EQ(f(1e30).value, 2.5);
  double before = f(-4).value, slope = 0;
  for (int i = 0; i < 12'000; ++i) {
    const double x = -4 + 1e-3 * i;
    const auto [value, first, second] = f(x);
    ASSERT_GE(value, 1 - 1e-12);
    ASSERT_LE(value, 9 + 1e-12);
    ASSERT_NEAR((value - before), 0.5e-3 * (first + slope), 2e-3);
    ASSERT_LT(std::abs(first - slope), 6) << "of 1e-3, at a curvature of up to 3000";
    before = value;
    slope = first;
  }
  constexpr double kStep = 1e-6;
  for (const double x : {-2.0, -0.4, 0.03, 2.0, 5.6}) {
    EXPECT_NEAR((f(x + kStep).value - f(x - kStep).value) / (2 * kStep), f(x).first, 1e-5 * (1 + std::abs(f(x).first)));
    EXPECT_NEAR((f(x + kStep).first - f(x - kStep).first) / (2 * kStep), f(x).second,
                1e-5 * (1 + std::abs(f(x).second)));
  }
}

TEST(FieldObject, NamesTheKeyThatIsWrong) {
  const auto read = [](const std::string& keys) {
    return error_of([&] {
      (void)scene_with(fmt::format(R"({{"kind": "volume", "file": "{}", "iso": 0{}}})", waves_file(), keys));
    });
  };
  EXPECT_THAT(read(R"(, "field": {})"), HasSubstr("field: give 'energy' or 'drag'"));
  EXPECT_THAT(read(R"(, "field": {"energy": [[0, 1]]})"), HasSubstr("field.energy: expected at least two points"));
  EXPECT_THAT(read(R"(, "field": {"energy": [[0, 1], [0, 2]]})"), HasSubstr("energy[1]: the value of the volume must"));
  EXPECT_THAT(read(R"(, "field": {"energy": [[0, 1], [1, 11]]})"), HasSubstr("energy[1]: energy is 11 J"));
  EXPECT_THAT(read(R"(, "field": {"drag": [[0, 1], [1, -1]]})"), HasSubstr("drag[1]: drag is -1 N s/m"));
  EXPECT_THAT(read(R"(, "field": {"drag": [[0, 1], [1]]})"), HasSubstr("drag[1]: expected two numbers"));
  EXPECT_THAT(read(R"(, "stiffness": 5, "field": {"drag": [[0, 1], [1, 2]]})"), HasSubstr("stiffness"));
  EXPECT_THAT(read(R"(, "interpolation": 1, "field": {"drag": [[0, 1], [1, 2]]})"), HasSubstr("a field needs 3"));
  EXPECT_THAT(
      error_of([] { (void)scene_with(R"({"kind": "sphere", "radius": 1, "field": {"drag": [[0, 1], [1, 2]]}})"); }),
      HasSubstr("field: only a volume has a field"));
}

}  // namespace
}  // namespace haptrace
