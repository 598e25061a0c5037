#include "control/path/shapes.h"

#include "base/error.h"
#include "control/path/min_jerk.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi;
using testing::HasSubstr;

double length(const Path& path) {
  double sum = 0;
  for (std::size_t i = 1; i < path.size(); ++i) sum += (path.position[i] - path.position[i - 1]).norm();
  return sum;
}

/// Returns the script's speed per rate of its parameter, from its definition.
double script_speed(const ShapeOptions& o, double q) {
  return o.size * std::hypot(10.0 / 12 / (22 * pi) + std::cos(q) / 12, std::sin(q) / 8);
}

double script_length(const ShapeOptions& o) {
  double sum = 0;
  const int n = 200;  // steps in one of the eleven equal loops
  for (int i = 0; i < n; ++i) sum += script_speed(o, 2 * pi * i / n) * 2 * pi / n;
  return 11 * sum;
}

/// Returns the script's parameter after the share u of the duration, and its rate per share. The parameter is the
/// integral of a rate that blends in over a twelfth of the duration and out over another.
std::pair<double, double> script_parameter(double u) {
  const auto rate = [](double at) { return 22 * pi * 12 / 11 * MinJerk::at(12 * at).s * MinJerk::at(12 * (1 - at)).s; };
  double q = 0;
  const int n = 6 * 64;  // Simpson's rule with whole cells in each blend, because the derivatives jump at a blend's end
  for (int i = 0; i < n; ++i) {
    const double from = std::min(u, static_cast<double>(i) / n), to = std::min(u, (i + 1.0) / n);
    q += (to - from) / 6 * (rate(from) + 4 * rate(0.5 * (from + to)) + rate(to));
  }
  return {q, rate(u)};
}

/// Returns the length of one turn [m], in closed form or, for the script and the figure eight, by integration.
double expected_length(const std::string& name, const ShapeOptions& o) {
  if (name == "square") return 4 * (o.size - 2 * o.blend) + 2 * pi * o.blend;
  if (name == "circle") return pi * o.size;
  if (name == "line") return 2 * o.size;
  if (name == "reach") return o.size;
  if (name == "spiral") {
    const double end = 2 * pi * o.turns;
    return o.size / 2 / end * 0.5 * (end * std::hypot(1, end) + std::asinh(end));
  }
  if (name == "script") return script_length(o);
  double sum = 0;
  const int n = 1000;  // the midpoint rule converges exponentially on a period
  for (int i = 0; i < n; ++i) sum += std::hypot(std::cos(2 * pi * i / n), std::cos(4 * pi * i / n)) * pi * o.size / n;
  return sum;
}

struct Variation {
  std::string name;
  ShapeOptions options;
};

std::vector<Variation> variations() {
  std::vector<Variation> all(1, {"Usual", {}});
  const auto add = [&all](const char* name) -> ShapeOptions& { return all.emplace_back(Variation{name, {}}).options; };
  add("ConstantSpeed").constant_speed = true;
  auto& turns = add("Turns");
  turns.turns = 3;
  turns.duration = 1.3;
  auto& elsewhere = add("Elsewhere");
  elsewhere.centre = {0.3, -0.2, 0.1};
  elsewhere.plane = "yz";
  elsewhere.angle = 0.7;
  add("InZx").plane = "zx";
  auto& small = add("Micrometres");
  small.size = 1e-5;
  small.blend = 1e-6;
  auto& large = add("Metres");
  large.size = 10;
  large.duration = 60;
  add("SharpCorners").blend = 0;
  add("RoundAsACircle").blend = 0.04;
  auto& slow = add("TenHertz");
  slow.rate_hz = 10;
  auto& fast = add("TwentyKilohertz");
  fast.rate_hz = 20000;
  fast.duration = 0.5;
  auto& uneven = add("DurationThatIsNoWholeNumberOfSteps");
  uneven.duration = 0.12345678;
  return all;
}

class ShapeLaws : public testing::TestWithParam<std::tuple<std::string, Variation>> {
 protected:
  void SetUp() override {
    if (name_ == "reach" || name_ == "script") options_.turns = 1;
    path_ = make_shape(name_, options_);
    whole_length_ = expected_length(name_, options_) * (closed() ? options_.turns : 1);
  }

  [[nodiscard]] bool closed() const { return name_ != "reach" && name_ != "spiral" && name_ != "script"; }
  [[nodiscard]] double total() const { return options_.duration * options_.turns; }
  /// Returns the speed that the options command at `t` [m/s].
  [[nodiscard]] double commanded_speed(double t) const {
    if (options_.constant_speed) return whole_length_ / total();
    if (name_ == "script") {
      const auto [q, rate] = script_parameter(t / total());
      return rate / total() * script_speed(options_, q);
    }
    const double movements = name_ == "line" ? 2.0 * options_.turns : 1;
    const double u = movements * t / total();
    return whole_length_ / total() * MinJerk::at(u - std::floor(u)).ds;
  }

  std::string name_ = std::get<0>(GetParam());
  ShapeOptions options_ = std::get<1>(GetParam()).options;
  Path path_;
  double whole_length_ = 0;  ///< Length of all turns [m].
};

TEST_P(ShapeLaws, IsAValidPathOfEqualStepsOverItsDuration) {
  EXPECT_NO_THROW(validate(path_));
  EXPECT_EQ(path_.name, name_);
  EXPECT_EQ(path_.velocity.size(), path_.size());
  EXPECT_EQ(path_.time.front(), 0);
  EXPECT_EQ(path_.time.back(), total());
  EXPECT_NEAR(static_cast<double>(path_.size() - 1), total() * options_.rate_hz, 0.5);
  const double step = total() / static_cast<double>(path_.size() - 1);
  for (std::size_t i = 1; i < path_.size(); ++i) ASSERT_NEAR(path_.time[i] - path_.time[i - 1], step, 1e-12);
}

TEST_P(ShapeLaws, EndsExactlyWhereItBeganWhenClosed) {
  if (closed()) {
    EXPECT_EQ(path_.position.front(), path_.position.back());
  } else {
    EXPECT_GE((path_.position.back() - path_.position.front()).norm(), 0.49 * options_.size);
  }
}

/// Laws of shapes whose speed is not constant.
class ShapesThatRest : public ShapeLaws {};
/// Laws of shapes that are sampled densely enough for finite differences.
class DenseShapeLaws : public ShapeLaws {};

TEST_P(ShapesThatRest, StartAndEndAtRest) {
  EXPECT_EQ(path_.velocity.front(), Vec3::Zero());
  EXPECT_EQ(path_.velocity.back(), Vec3::Zero());
}

TEST_P(ShapeLaws, MovesAtTheCommandedSpeed) {
  const std::size_t step = name_ == "script" ? 20 : 1;  // the script's integral is slow
  for (std::size_t i = 0; i < path_.size(); i += step) {
    const double speed = commanded_speed(path_.time[i]);
    ASSERT_NEAR(path_.velocity[i].norm(), speed, 1e-6 * speed + 1e-12 * options_.size) << "sample " << i;
  }
}

TEST_P(ShapeLaws, HasTheLengthOfItsShape) {
  // Chords are shorter than the arc by the square of the step, and cut corners. The script turns eleven times.
  const double steps = static_cast<double>(path_.size()) / (closed() ? options_.turns : 1);
  EXPECT_NEAR(length(path_) / whole_length_, 1,
              (name_ == "script" ? 400 : 150) / (steps * steps) + (name_ == "square" ? 2 / steps : 0) + 1e-9);
}

TEST_P(DenseShapeLaws, ReportsTheVelocityOfItsPositions) {
  // The velocity is undefined at the turning points of a line at constant speed, and at corners that are sharp or turn
  // within a few samples.
  const double peak = whole_length_ / total() * MinJerk::kPeakSpeed;
  std::size_t unlike = 0;
  for (std::size_t i = 1; i + 1 < path_.size(); ++i) {
    const double h = path_.time[i + 1] - path_.time[i - 1];
    const Vec3 v = (path_.position[i + 1] - path_.position[i - 1]) / h;
    if ((v - path_.velocity[i]).norm() > 0.02 * peak) ++unlike;
  }
  EXPECT_LE(static_cast<double>(unlike), 0.02 * static_cast<double>(path_.size()) + 12 * options_.turns);
}

TEST_P(ShapeLaws, StaysWithinItsSizeInItsPlane) {
  const Box box = path_.bounds();
  const double half = options_.size / 2;
  const int normal = options_.plane == "xy" ? 2 : options_.plane == "yz" ? 0 : 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double reach = axis == normal ? 0 : name_ == "reach" ? options_.size : half;
    EXPECT_LE(box.max[axis], options_.centre[axis] + reach + 1e-14);
    EXPECT_GE(box.min[axis], options_.centre[axis] - reach - 1e-14);
  }
}

TEST_P(ShapeLaws, IsTheSameInEveryPlane) {
  ShapeOptions in_xy = options_;
  in_xy.plane = "xy";
  in_xy.centre.setZero();
  const Path flat = make_shape(name_, in_xy);
  const int right = options_.plane == "xy" ? 0 : options_.plane == "yz" ? 1 : 2;
  for (std::size_t i = 0; i < path_.size(); ++i) {
    const Vec3 p = path_.position[i] - options_.centre;
    ASSERT_NEAR(p[right], flat.position[i].x(), 1e-15 * (1 + options_.size));
    ASSERT_NEAR(p[(right + 1) % 3], flat.position[i].y(), 1e-15 * (1 + options_.size));
  }
}

using ShapeCase = std::tuple<std::string, Variation>;

template <class Applies>
auto shapes_that(Applies applies) {
  std::vector<ShapeCase> cases;
  for (const std::string& shape : shape_names())
    for (const Variation& variation : variations())
      if (applies(shape, variation.options)) cases.emplace_back(shape, variation);
  return testing::ValuesIn(cases);
}

std::string name_of_shape(const testing::TestParamInfo<ShapeCase>& tested) {
  return std::get<0>(tested.param) + std::get<1>(tested.param).name;
}

bool is_dense(const std::string& shape, const ShapeOptions& options) {
  // A script turns eleven times.
  return options.rate_hz >= 1000 && (shape != "script" || options.rate_hz * options.duration >= 999);
}

INSTANTIATE_TEST_SUITE_P(All, ShapeLaws, shapes_that([](const auto&, const auto&) { return true; }), name_of_shape);
INSTANTIATE_TEST_SUITE_P(All, ShapesThatRest,
                         shapes_that([](const auto&, const ShapeOptions& options) { return !options.constant_speed; }),
                         name_of_shape);
INSTANTIATE_TEST_SUITE_P(All, DenseShapeLaws, shapes_that(is_dense), name_of_shape);

const Vec3 at(const Path& path, double fraction) {
  return path.position[static_cast<std::size_t>(std::lround(fraction * static_cast<double>(path.size() - 1)))];
}

void expect_near(const Vec3& a, const Vec3& b) {
  EXPECT_LE((a - b).norm(), 1e-12) << a.transpose();
}

TEST(Shapes, BeginAtTheirDocumentedPoint) {
  ShapeOptions o;
  o.size = 0.1;
  o.blend = 0.01;
  expect_near(make_shape("square", o).position[0], {-0.04, -0.05, 0});
  expect_near(make_shape("circle", o).position[0], {0.05, 0, 0});
  expect_near(make_shape("line", o).position[0], {-0.05, 0, 0});
  expect_near(make_shape("figure8", o).position[0], {0, 0, 0});
  expect_near(make_shape("reach", o).position[0], {0, 0, 0});
  expect_near(make_shape("spiral", o).position[0], {0, 0, 0});
  expect_near(make_shape("script", o).position[0], {-0.1 * 5 / 12, -0.1 / 8, 0});
  o.blend = 0;
  expect_near(make_shape("square", o).position[0], {-0.05, -0.05, 0});
}

TEST(Shapes, GoRoundCounterclockwise) {
  ShapeOptions o;
  o.size = 0.1;
  o.blend = 0;
  o.constant_speed = true;
  const Path square = make_shape("square", o);
  expect_near(at(square, 0.25), {0.05, -0.05, 0});
  expect_near(at(square, 0.5), {0.05, 0.05, 0});
  expect_near(at(square, 0.75), {-0.05, 0.05, 0});
  expect_near(at(make_shape("circle", o), 0.25), {0, 0.05, 0});
  EXPECT_GT(make_shape("spiral", o).position[10].y(), 0);
}

TEST(Shapes, ReachAndLineGoAlongTheirAngle) {
  ShapeOptions o;
  o.size = 0.1;
  o.angle = pi / 6;
  const Vec3 direction(std::cos(pi / 6), 0.5, 0);
  const Path reach = make_shape("reach", o), line = make_shape("line", o);
  expect_near(reach.position.back(), 0.1 * direction);
  expect_near(at(reach, 0.3), 0.1 * MinJerk::at(0.3).s * direction);
  expect_near(at(line, 0.5), 0.05 * direction);
  EXPECT_LE(line.velocity[line.size() / 2].norm(), 1e-12) << "turns at rest";
}

TEST(Shapes, SpiralGrowsEvenlyToItsDiameter) {
  ShapeOptions o;
  o.size = 0.1;
  o.turns = 5;
  o.constant_speed = true;
  const Path spiral = make_shape("spiral", o);
  expect_near(spiral.position.back(), {0.05, 0, 0});
  double angle = 0;
  for (std::size_t i = 2; i < spiral.size(); ++i) {
    const Vec3 a = spiral.position[i - 1], b = spiral.position[i];
    angle += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    ASSERT_NEAR(b.norm(), (angle + spiral.position[1].norm() / 0.05 * 10 * pi) * 0.05 / (10 * pi), 1e-9);
  }
}

TEST(Shapes, ScriptWritesElevenLoopsAtTwoASecond) {
  ShapeOptions o;
  o.size = 0.108;
  o.duration = 6;
  const Path script = make_shape("script", o);
  double peak = 0, turned = 0;
  int tops = 0;
  for (std::size_t i = 1; i + 1 < script.size(); ++i) {
    const Vec3 v = script.velocity[i], next = script.velocity[i + 1];
    peak = std::max(peak, v.norm());
    turned += std::atan2(v.x() * next.y() - v.y() * next.x(), v.dot(next));
    if (v.y() > 0 && next.y() <= 0) {
      ++tops;
      EXPECT_LT(v.x(), 0) << "the pen goes back over the top of a loop";
      EXPECT_NEAR(script.position[i].y(), 0.108 / 8, 1e-5);
    }
  }
  EXPECT_EQ(tops, 11);
  EXPECT_NEAR(turned, 22 * pi, 0.1) << "counterclockwise";
  EXPECT_NEAR(peak, 0.172, 0.002);
  expect_near(script.position.back(), {0.045, -0.0135, 0});
  // After half a second the script has reached its full rate. From then on a loop takes half a second.
  expect_near(script.position[2000] - script.position[1500], Vec3(0.09 / 11, 0, 0));
}

TEST(Shapes, FigureEightIsTheLemniscateOfGerono) {
  ShapeOptions o;
  o.size = 0.1;
  const double a = 0.05;
  for (const Vec3& p : make_shape("figure8", o).position)
    ASSERT_NEAR(std::pow(p.x() / a, 4), std::pow(p.x() / a, 2) - std::pow(p.y() / a, 2), 1e-12);
}

TEST(Shapes, CornersHaveTheRadiusOfTheirBlend) {
  ShapeOptions o;
  o.size = 0.1;
  o.blend = 0.01;
  o.constant_speed = true;
  const Path path = make_shape("square", o);
  std::size_t round = 0;
  for (std::size_t i = 1; i + 1 < path.size(); ++i) {
    // Menger curvature of three samples.
    const Vec3 a = path.position[i] - path.position[i - 1], b = path.position[i + 1] - path.position[i];
    const double curvature = 2 * a.cross(b).norm() / (a.norm() * b.norm() * (a + b).norm());
    const Vec3 p = path.position[i].cwiseAbs();
    const double margin = 2 * a.norm();
    if (p.x() > 0.04 + margin && p.y() > 0.04 + margin) {
      ASSERT_NEAR(curvature, 100, 1e-6);
      ++round;
    } else if (p.x() < 0.04 - margin || p.y() < 0.04 - margin) {
      ASSERT_NEAR(curvature, 0, 1e-6);
    }
  }
  EXPECT_GT(round, 300u);
}

TEST(Shapes, SpaceTheirSamplesEvenlyAtConstantSpeed) {
  ShapeOptions o;
  o.rate_hz = 20000;
  o.constant_speed = true;
  o.blend = 0.02;
  for (const char* name : {"square", "circle", "figure8", "spiral", "reach", "script"}) {
    const Path path = make_shape(name, o);
    const double step = expected_length(name, o) / static_cast<double>(path.size() - 1);
    for (std::size_t i = 1; i < path.size(); ++i)
      ASSERT_NEAR((path.position[i] - path.position[i - 1]).norm() / step, 1, 1e-6) << name << " sample " << i;
  }
}

TEST(Shapes, OfSharpCornersAreFiniteWhateverTheirSize) {
  ShapeOptions o;
  o.blend = 0;
  o.rate_hz = 40;
  o.duration = 0.1;
  o.turns = 3;
  o.constant_speed = true;  // a sample on every corner, up to rounding
  for (int i = 1; i < 5000; ++i) {
    o.size = 1e-3 * i / 7;
    EXPECT_NO_THROW(validate(make_shape("square", o)));
  }
}

std::string refusal(const std::string& name, const std::function<void(ShapeOptions&)>& change) {
  ShapeOptions o;
  change(o);
  try {
    make_shape(name, o);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), Error::Kind::input);
    return error.what();
  }
  return "nothing was thrown";
}

TEST(Shapes, RefuseOptionsNamingThemAndTheirRange) {
  for (const double bad : {0.0, -0.1, kNaN, 11.0, std::numeric_limits<double>::infinity()})
    EXPECT_THAT(refusal("circle", [=](auto& o) { o.size = bad; }), HasSubstr("it must be 1e-06 to 10 m"));
  EXPECT_EQ(refusal("circle", [](auto& o) { o.size = -0.1; }), "shape: size is -0.1 m; it must be 1e-06 to 10 m");
  EXPECT_EQ(refusal("line", [](auto& o) { o.duration = 0; }), "shape: duration is 0 s; it must be 0.001 to 1e+06 s");
  EXPECT_EQ(refusal("line", [](auto& o) { o.rate_hz = 1; }), "shape: rate is 1 Hz; it must be 10 to 20000 Hz");
  EXPECT_EQ(refusal("line", [](auto& o) { o.turns = 0; }), "shape: turns is 0; it must be 1 to 10000");
  EXPECT_EQ(refusal("reach", [](auto& o) { o.turns = 2; }), "shape: turns is 2; it must be 1 to 1");
  EXPECT_EQ(refusal("square", [](auto& o) { o.blend = 0.05; }), "shape: blend is 0.05 m; it must be 0 to 0.04 m");
  EXPECT_THAT(refusal("square", [](auto& o) { o.blend = kNaN; }), HasSubstr("blend is nan m"));
  EXPECT_THAT(refusal("square", [](auto& o) { o.centre.y() = kNaN; }), HasSubstr("centre is nan m"));
  EXPECT_THAT(refusal("line", [](auto& o) { o.angle = kNaN; }), HasSubstr("angle is nan rad"));
  EXPECT_EQ(refusal("line", [](auto& o) { o.plane = "xz"; }), "shape: plane is 'xz'; it must be xy, yz or zx");
  EXPECT_EQ(refusal("line", [](auto& o) { o.duration = 1e6; }),
            "shape: duration * turns * rate is 1e+09 samples; at most 1e+08 are possible");
}

TEST(Shapes, RefuseAnUnknownNameAndListTheKnownOnes) {
  EXPECT_EQ(refusal("sqare", [](auto&) {}),
            "shape 'sqare' is not known; known: square, circle, line, figure8, reach, spiral, script");
}

}  // namespace
}  // namespace haptrace
