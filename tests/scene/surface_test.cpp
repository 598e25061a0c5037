// The feel of a contact: stiffness laws, friction, adhesion, shading.
#include "scene/shape/plane.h"
#include "scene/surface/detailed.h"
#include "scene/surface/friction.h"
#include "tests/scene/alone.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;
using test::Alone;
using test::error_of;
using testing::HasSubstr;

constexpr double kSurfaceTick = 1e-3;  // [s]

/// Returns a floor in the plane z = 0 with these keys of a surface.
std::string floor_with(const std::string& surface) {
  return R"({"kind": "plane", "point": 0, "normal": [0, 0, 1], )" + surface + "}";
}

/// Returns a ball of 30 mm around the origin with these keys of a surface.
std::string ball_with(const std::string& surface) {
  return R"({"kind": "sphere", "radius": 0.03, )" + surface + "}";
}

/// Moves the tool of `object` along places at one a tick.
class Stroke {
 public:
  explicit Stroke(Alone& object) : object_(object) {}
  Contact to(const Vec3& place) {
    const Vec3 velocity = is_finite(last_) ? Vec3((place - last_) / kSurfaceTick) : Vec3(Vec3::Zero());
    last_ = place;
    return object_.answer({place, velocity, kSurfaceTick});
  }

 private:
  Alone& object_;
  Vec3 last_ = nan3();
};

TEST(StiffnessLaws, FollowHertzInForceSlopeAndEnergy) {
  const StiffnessLaw law = StiffnessLaw::hertz(1e5, 0.01);
  for (const double d : {1e-6, 1e-4, 1e-3, 5e-3}) {
    const Elastic elastic = law.at(d);
    EXPECT_NEAR(elastic.force, 4.0 / 3 * 1e5 * std::sqrt(0.01) * std::pow(d, 1.5), 1e-12 * elastic.force);
    EXPECT_NEAR(elastic.stored, 8.0 / 15 * 1e5 * std::sqrt(0.01) * std::pow(d, 2.5), 1e-12);
    EXPECT_NEAR(elastic.stiffness, (law.at(d * 1.0001).force - law.at(d * 0.9999).force) / (2e-4 * d),
                1e-6 * elastic.stiffness);
  }
  Alone floor(floor_with(R"("hertz": {"modulus": 1e5, "radius": 0.01})"));
  const double one = floor.answer({.position = Vec3(0, 0, -1e-3)}).force.z();
  const double two = floor.answer({.position = Vec3(0, 0, -2e-3)}).force.z();
  EXPECT_NEAR(std::log2(two / one), 1.5, 1e-9) << "the exponent of Hertz";
}

TEST(StiffnessLaws, FollowATableAndItsIntegral) {
  const StiffnessLaw law = StiffnessLaw::table({{0, 0}, {1e-3, 0.5}, {2e-3, 0.5}, {4e-3, 4}});
  EXPECT_NEAR(law.at(5e-4).force, 0.25, 1e-12);
  EXPECT_NEAR(law.at(1.5e-3).force, 0.5, 1e-12);
  EXPECT_NEAR(law.at(1.5e-3).stiffness, 0, 1e-12);
  EXPECT_NEAR(law.at(3e-3).force, 2.25, 1e-12);
  EXPECT_NEAR(law.at(6e-3).force, 7.5, 1e-12) << "continued with its last slope";
  double sum = 0;
  constexpr int kSteps = 100'000;
  for (int i = 0; i < kSteps; ++i) sum += law.at((i + 0.5) * 6e-3 / kSteps).force * 6e-3 / kSteps;
  EXPECT_NEAR(law.at(6e-3).stored, sum, 1e-9);
}

TEST(StiffnessLaws, RefuseATableThatIsNone) {
  const auto error = [](const char* table) { return error_of([&] { Alone(floor_with(table)); }); };
  EXPECT_THAT(error(R"("table": [[0, 0]])"), HasSubstr("objects[0]: table: needs at least two points"));
  EXPECT_THAT(error(R"("table": [[0, 1], [1, 2]])"), HasSubstr("table[0]: the table begins at [0, 0]"));
  EXPECT_THAT(error(R"("table": [[0, 0], [0.001, 1], [0.001, 2]])"), HasSubstr("table[2]: the depth"));
  EXPECT_THAT(error(R"("table": [[0, 0], [0.001, 1], [0.002, 0.5]])"), HasSubstr("table[2]: the force"));
  EXPECT_THAT(error(R"("table": [[0, 0], 5])"), HasSubstr("objects[0].table: expected a list of points"));
  EXPECT_THAT(error(R"("table": [[0, 0], [1, 1]], "stiffness": 5)"), HasSubstr("keep one of them"));
}

/// A mass on the floor, pulled by a spring whose other end moves: the classic of stick and slip.
struct StickSlip {
  static constexpr double kMass = 0.05, kSpring = 200, kSpeed = 0.01, kLoad = 2;  // [kg], [N/m], [m/s], [N]
  static constexpr double kStatic = 0.5, kDynamic = 0.3;                          // Fs = 1 N, Fc = 0.6 N

  /// Returns the pull of the spring at every tick.
  static std::vector<double> pulls(double rate_hz, double seconds, double bristle, double damping) {
    Alone floor(floor_with(fmt::format(
                    R"("stiffness": 1000, "friction": {{"static": {}, "dynamic": {}, "bristle": {}, "damping": {}}})",
                    kStatic, kDynamic, bristle, damping)),
                Vec3(0, 0, 1e-3), rate_hz);
    const double dt = 1 / rate_hz, depth = kLoad / 1000;
    double x = 0, v = 0;
    std::vector<double> pulls;
    for (double t = 0; t < seconds; t += dt) {
      const double pull = kSpring * (kSpeed * t - x);
      const double friction = floor.answer({Vec3(x, 0, -depth), Vec3(v, 0, 0), dt}).force.x();
      v += dt / kMass * (pull + friction);
      x += dt * v;
      pulls.push_back(pull);
    }
    return pulls;
  }

  /// Returns the mean time between two slips, which begin at the maxima of the pull; 0 for fewer than 11 slips.
  static double period(const std::vector<double>& pulls, double rate_hz) {
    std::vector<double> begins;
    for (std::size_t i = 1; i + 1 < pulls.size(); ++i)
      if (pulls[i] > 0.9 && pulls[i] >= pulls[i - 1] && pulls[i] > pulls[i + 1] &&
          (begins.empty() || static_cast<double>(i) / rate_hz - begins.back() > 0.1))
        begins.push_back(static_cast<double>(i) / rate_hz);
    return begins.size() > 10 ? (begins.back() - begins[1]) / static_cast<double>(begins.size() - 2) : 0;
  }
};

TEST(Friction, SticksAndSlipsWithThePeriodOfTheory) {
  constexpr double kRate = 1000;
  const std::vector<double> pulls = StickSlip::pulls(kRate, 8, 4e4, 45);
  const double w = std::sqrt(StickSlip::kSpring / StickSlip::kMass),
               rise = 2 * (1 - 0.6) / (StickSlip::kSpring * StickSlip::kSpeed);
  const double theory = rise + 2 * (pi - std::atan(0.4 * w / (StickSlip::kSpring * StickSlip::kSpeed))) / w;
  EXPECT_NEAR(theory, 0.4522, 1e-3) << "the case of the reference";
  EXPECT_NEAR(StickSlip::period(pulls, kRate), theory, 0.01 * theory);
  EXPECT_NEAR(*std::max_element(pulls.begin(), pulls.end()), 1, 0.02);
}

TEST(Friction, NeedsAStiffDampedBristleToStickAsInTheory) {
  constexpr double kRate = 1000, kTheory = 0.4522;
  // The surface's stiffness, and no damping: the defaults. After its first slip the mass slides on.
  const std::vector<double> pulls = StickSlip::pulls(kRate, 8, 1000, 0);
  for (std::size_t i = 1000; i < pulls.size(); ++i) ASSERT_NEAR(pulls[i], 0.6, 0.05) << i;
  EXPECT_NEAR(StickSlip::period(StickSlip::pulls(kRate, 8, 1000, 2), kRate) / kTheory, 1.09, 0.02);
  EXPECT_NEAR(StickSlip::period(StickSlip::pulls(kRate, 8, 1e4, 20), kRate) / kTheory, 1, 0.01);
}

TEST(Friction, IsASpringBeforeItSlides) {
  Alone floor(floor_with(R"("stiffness": 1000, "friction": {"static": 0.5, "dynamic": 0.3, "bristle": 4000})"));
  Stroke stroke(floor);
  (void)stroke.to({0, 0, -1e-3});
  for (int i = 1; i <= 10; ++i) {
    const Contact contact = stroke.to({1e-5 * i, 0, -1e-3});
    EXPECT_NEAR(contact.force.x(), -4000 * 1e-5 * i, 1e-12);
    EXPECT_NEAR(contact.stored, 0.5 * 1000 * 1e-6 + 0.5 * 4000 * std::pow(1e-5 * i, 2), 1e-15);
  }
  EXPECT_NEAR(stroke.to({2e-3, 0, -1e-3}).force.x(), -0.3, 1e-12) << "dynamic while it slides";
  EXPECT_NEAR(stroke.to({2e-3, 1e-3, -1e-3}).force.head<2>().norm(), 0.3, 1e-12);
  EXPECT_LT(stroke.to({2e-3, 3e-3, -1e-3}).force.y(), -0.29) << "against the movement";
  EXPECT_EQ(stroke.to({2e-3, 3e-3, 1e-3}).force, Vec3::Zero()) << "no load, no friction";
}

TEST(Friction, BringsATinyLoopBackToWhereItBegan) {
  Alone floor(floor_with(R"("stiffness": 1000, "friction": {"static": 0.5, "dynamic": 0.3, "bristle": 4000})"));
  Stroke stroke(floor);
  (void)stroke.to({0, 0, -1e-3});
  for (int cycle = 0; cycle < 100'000; ++cycle)
    for (const Vec3& corner : {Vec3(4e-5, 0, -1e-3), Vec3(4e-5, 4e-5, -1e-3), Vec3(0, 4e-5, -1e-3), Vec3(0, 0, -1e-3)})
      (void)stroke.to(corner);
  EXPECT_LT(stroke.to({0, 0, -1e-3}).force.head<2>().norm(), 1e-6);
}

/// Returns the work that the object gives to a tool which wanders at random around a place of its surface, beyond the
/// energy that its springs hold. The force of a tick acts at the next place, as a spring without the error of sampling.
double work_of_a_walk(Alone& object, const Vec3& around, double reach, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> push;
  Vec3 place = around, velocity = Vec3::Zero();
  Stroke stroke(object);
  Contact before = stroke.to(around);
  double given = 0, worst = 0;
  for (int i = 0; i < 40'000; ++i) {
    velocity +=
        Vec3(push(random), push(random), push(random)) * reach * 2e-3 - 2e-3 * (place - around) - 0.02 * velocity;
    const Vec3 next = place + 0.05 * velocity;
    const Contact contact = stroke.to(next);
    given += 0.5 * (before.force + contact.force).dot(next - place);
    worst = std::max(worst, given + contact.stored);
    place = next;
    before = contact;
  }
  return worst;
}

TEST(Friction, NeverGivesEnergyOnFlatAndRoundShapes) {
  for (const char* more : {R"("static": 0.8, "dynamic": 0.5)", R"("static": 0.3, "dynamic": 0.3, "viscous": 1)",
                           R"("dynamic": 0.4, "periodic": {"period": 0.002, "amplitude": 0.9})",
                           R"("dynamic": 0.4, "sandpaper": {"sigma": 0.5, "grain": 0.0005})"}) {
    const std::string keys = fmt::format(R"("stiffness": 800, "friction": {{{}, "bristle": 3000}})", more);
    Alone floor(floor_with(keys)), ball(ball_with(keys));
    EXPECT_LT(work_of_a_walk(floor, Vec3(0, 0, 1e-3), 4e-3, 1), 2e-5) << more;
    EXPECT_LT(work_of_a_walk(ball, Vec3(0, 0, 0.031), 4e-3, 2), 2e-5) << more;
  }
}

/// Returns the largest work that a friction has given to the hand, beyond the energy in its bristle [J], over random
/// strokes of one kind: forwards only, or to and fro, or over a surface that turns. The normal force varies.
enum class StrokeKind : std::uint8_t { forwards, to_and_fro, turning };
double work_of_friction(const FrictionSpec& spec, StrokeKind kind, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal_number;
  std::uniform_real_distribution<double> share(0, 1);
  const auto any = [&] { return Vec3(normal_number(random), normal_number(random), normal_number(random)); };
  const Friction friction(spec);
  const Plane plane(PlaneSpec{});
  SurfaceMemory memory;
  Vec3 normal = Vec3::UnitZ(), place = Vec3::Zero();
  double load = 1, given = 0, worst = 0;
  for (int i = 0; i < 2000; ++i) {
    if (i % 10 == 0) load = i % 200 == 190 ? 0 : 2 * share(random);
    if (kind == StrokeKind::turning) normal = (normal + 0.05 * any()).normalized();
    // Slow and fast ticks: within the bristle, and far beyond it.
    const double far = std::pow(10, -6 + 3 * share(random));
    const Vec3 step = kind == StrokeKind::forwards ? Vec3(far * Vec3(1, 0.3, 0)) : Vec3(far * any());
    const ToolStep tool{.from = place, .to = place + step};
    const Proxy proxy{.position = tool.to, .normal = normal, .depth = 1e-3, .known = true, .touching = true};
    place = tool.to;
    const Press press{
        .shape = plane, .proxy = proxy, .step = tool, .velocity = step / kSurfaceTick, .dt = kSurfaceTick};
    given += friction.pull(press, normal, load, memory).dot(step);
    worst = std::max(worst, given + friction.stored(memory));
  }
  return worst;
}

TEST(Friction, GivesNoMoreWorkThanItsBristleHeldWhateverTheStroke) {
  const PeriodicFriction wave{.period = 2e-3, .amplitude = 0.9};
  const SandpaperFriction paper{.sigma = 0.5, .grain = 5e-4};
  const std::vector<FrictionSpec> kinds{
      {.fixed = 1, .dynamic = 0.1, .bristle = 1553.65, .damping = 4.6912},
      {.fixed = 1, .dynamic = 0.1, .bristle = 1e3},
      {.fixed = 0.5, .dynamic = 0.5, .bristle = 1e4, .damping = 20},
      {.fixed = 1, .dynamic = 0, .bristle = 1e3, .damping = 1e3},
      {.fixed = 0.8, .dynamic = 0.4, .bristle = 4e4, .damping = 45, .viscous = 2},
      {.fixed = 0.8, .dynamic = 0.4, .bristle = 3e3, .damping = 2, .periodic = wave},
      {.fixed = 0.8, .dynamic = 0.4, .bristle = 3e3, .damping = 2, .sandpaper = paper},
      {.fixed = 0.8, .dynamic = 0.4, .bristle = 3e3, .viscous = 1, .periodic = wave, .sandpaper = paper},
  };
  for (std::size_t i = 0; i < kinds.size(); ++i)
    for (const StrokeKind stroke : {StrokeKind::forwards, StrokeKind::to_and_fro, StrokeKind::turning})
      for (unsigned seed = 0; seed < 20; ++seed)
        EXPECT_LT(work_of_friction(kinds[i], stroke, seed), 1e-12)
            << "kind " << i << ", stroke " << static_cast<int>(stroke) << ", seed " << seed;
}

TEST(Friction, GivesNoWorkOverAForwardStrokeOfSlowAndFastTicks) {
  // Slow loading, two fast ticks, slow unloading: a bristle that its damper turned round would push here.
  const Friction friction({.fixed = 1, .dynamic = 0.1, .bristle = 1553.65, .damping = 4.6912});
  const Plane plane(PlaneSpec{});
  SurfaceMemory memory;
  double x = 0, given = 0;
  const auto move = [&](double step) {
    const ToolStep tool{.from = Vec3(x, 0, 0), .to = Vec3(x + step, 0, 0)};
    const Proxy proxy{.position = tool.to, .normal = Vec3::UnitZ(), .depth = 1e-3, .known = true, .touching = true};
    const Press press{.shape = plane, .proxy = proxy, .step = tool, .dt = kSurfaceTick};
    const Vec3 force = friction.pull(press, Vec3::UnitZ(), 1, memory);
    x += step;
    given += force.x() * step;
    EXPECT_LE(force.x(), 0) << "friction never pushes a tool that only moves forwards";
  };
  move(0);
  for (int cycle = 0; cycle < 6; ++cycle) {
    for (int i = 0; i < 40; ++i) move(1.5e-5);
    for (int i = 0; i < 2; ++i) move(3e-4);
    for (int i = 0; i < 40; ++i) move(1e-5);
  }
  EXPECT_LT(given, 0);
}

TEST(Friction, DoesNotChatterFromOneCountOfAnEncoder) {
  constexpr double kCount = 5e-5;
  Alone floor(floor_with(R"("stiffness": 1000, "friction": {"static": 0.5, "dynamic": 0.3, "bristle": 1000})"));
  Stroke stroke(floor);
  (void)stroke.to({0, 0, -2e-3});
  double most = 0, before = 0;
  for (int i = 0; i < 1000; ++i) {
    const double x = kCount * (i % 2);
    const double force = stroke.to({x, 0, -2e-3}).force.x();
    most = std::max(most, std::abs(force - before));
    before = force;
  }
  EXPECT_LE(most, 1000 * kCount * 1.001) << "the bristle's, not twice the friction";
}

TEST(Friction, VariesPeriodicallyAndFromGrainToGrainTheSameAtEveryStroke) {
  const auto slide = [](const std::string& more) {
    Alone floor(
        floor_with(fmt::format(R"("stiffness": 1000, "friction": {{"dynamic": 0.4, "bristle": 1e6, {}}})", more)));
    Stroke stroke(floor);
    std::vector<double> forces;
    for (int i = 0; i < 4000; ++i) forces.push_back(-stroke.to({1e-5 * i, 0, -1e-3}).force.x());
    return forces;
  };
  const std::vector<double> wave = slide(R"("periodic": {"period": 0.004, "amplitude": 0.5})");
  EXPECT_NEAR(*std::max_element(wave.begin() + 100, wave.end()), 0.6, 2e-3);
  EXPECT_NEAR(*std::min_element(wave.begin() + 100, wave.end()), 0.2, 2e-3);
  EXPECT_NEAR(wave[1100], wave[1500], 2e-3) << "a period further";
  const std::string paper = R"("sandpaper": {"sigma": 0.2, "grain": 0.00001})";
  const std::vector<double> once = slide(paper), again = slide(paper);
  EXPECT_EQ(once, again);
  double sum = 0, squares = 0;
  for (std::size_t i = 100; i < once.size(); ++i) {
    sum += once[i];
    squares += once[i] * once[i];
  }
  const double n = static_cast<double>(once.size() - 100), mean = sum / n;
  EXPECT_NEAR(mean, 0.4, 0.01);
  EXPECT_NEAR(std::sqrt(squares / n - mean * mean), 0.08, 0.01);
}

TEST(Adhesion, PullsUpToItsLimitWhileTheToolLeavesAndGivesBackNoMoreThanItTook) {
  Alone floor(floor_with(R"("stiffness": 1000, "adhesion": {"force": 0.5, "stiffness": 500})"));
  Stroke stroke(floor);
  for (int i = 0; i < 20; ++i)
    EXPECT_EQ(stroke.to({0, 0, 1e-3 - 4e-5 * i}).force, Vec3::Zero()) << "nothing on the way in";
  (void)stroke.to({0, 0, -1e-3});
  EXPECT_NEAR(stroke.to({0, 0, 5e-4}).force.z(), -0.25, 1e-12);
  EXPECT_NEAR(stroke.to({0, 0, 9.9e-4}).force.z(), -0.495, 1e-12);
  EXPECT_NEAR(stroke.to({0, 0, 2e-4}).force.z(), -0.1, 1e-12) << "back, while it holds";
  EXPECT_EQ(stroke.to({0, 0, 1.01e-3}).force, Vec3::Zero()) << "beyond 0.5 N it lets go";
  EXPECT_EQ(stroke.to({0, 0, 5e-4}).force, Vec3::Zero()) << "and does not catch a tool outside";
  Alone again(floor_with(R"("stiffness": 800, "adhesion": {"force": 0.5, "stiffness": 500})"));
  EXPECT_LT(work_of_a_walk(again, Vec3(0, 0, 3e-4), 2e-3, 3), 2e-5);
}

TEST(DetailedSurface, DampsOnlyTheWayInAndNeverPulls) {
  Alone floor(floor_with(R"("stiffness": 500, "damping": 4, "friction": {"dynamic": 0})"));
  EXPECT_NEAR(floor.answer({Vec3(0, 0, -1e-3), Vec3(0, 0, -0.5), kSurfaceTick}).force.z(), 0.5 + 2, 1e-12);
  EXPECT_NEAR(floor.answer({Vec3(0, 0, -1e-3), Vec3(0, 0, 0.5), kSurfaceTick}).force.z(), 0.5, 1e-12);
}

TEST(DetailedSurface, StaysFiniteAndAllocatesNothingAtTheEndsOfItsRanges) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> side(-1, 1);
  for (
      const char* keys :
      {R"("stiffness": 1e9, "friction": {"static": 10, "dynamic": 10, "bristle": 1e9})",
       R"("hertz": {"modulus": 1e13, "radius": 100}, "friction": {"dynamic": 10, "viscous": 100})",
       R"("stiffness": 0, "friction": {"dynamic": 1}, "adhesion": {"force": 100})",
       R"("stiffness": 1e9, "texture": {"kind": "perlin", "amplitude": 0.1, "wavelength": 1e-6}, "adhesion": {"force": 1}, "shading": true)"}) {
    Alone ball(ball_with(keys));
    Stroke stroke(ball);
    const std::size_t before = test::allocations();
    for (int i = 0; i < 3000; ++i) {
      const double far = i % 100 == 0 ? 1e5 : 0.035;
      const Contact contact = stroke.to(far * Vec3(side(random), side(random), side(random)));
      ASSERT_TRUE(is_finite(contact.force)) << keys;
      ASSERT_TRUE(std::isfinite(contact.stored));
    }
    EXPECT_EQ(test::allocations(), before) << keys;
  }
}

TEST(DetailedSurface, NamesAWrongKey) {
  const auto error = [](const char* keys) { return error_of([&] { Alone(floor_with(keys)); }); };
  EXPECT_THAT(error(R"("stiffness": 1, "friction": {"statik": 1})"), HasSubstr("objects[0].friction"));
  EXPECT_THAT(error(R"("stiffness": 1, "friction": {"static": 0.1, "dynamic": 0.2})"), HasSubstr("is below 'dynamic'"));
  EXPECT_THAT(error(R"("stiffness": 1, "shading": 3)"), HasSubstr("objects[0].shading: expected"));
  EXPECT_THAT(error(R"("stiffness": 1, "texture": {"kind": "perlim"})"), HasSubstr("did you mean 'perlin'?"));
  EXPECT_THAT(error(R"("stiffness": 1, "adhesion": {})"), HasSubstr("'force' is missing"));
}

}  // namespace
}  // namespace haptrace
