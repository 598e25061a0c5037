#include "tests/control/path/trainees.h"

#include "control/path/place_tracker.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

namespace haptrace::test {
namespace {

using std::numbers::pi;

constexpr double kTick = 1e-3;       // [s]
constexpr double kFineStep = 1e-4;   // between the points of curves [m]
constexpr double kGraceTurn = 0.02;  // movement after an early turn, and ...
constexpr double kGraceLost = 0.04;  // ... after a skip, an excursion or a start in the middle, in grace [m]

Stroke polyline(std::string name, std::vector<Vec3> points) {
  Stroke stroke{std::move(name), std::move(points), {}};
  double s = 0;
  for (std::size_t i = 1; i + 1 < stroke.points.size(); ++i) {
    s += (stroke.points[i] - stroke.points[i - 1]).norm();
    stroke.corners.push_back(s);
  }
  return stroke;
}

Stroke curve(std::string name, double length, const std::function<Vec3(double)>& at) {
  Stroke stroke{std::move(name), {}, {}};
  const int steps = static_cast<int>(length / kFineStep);
  for (int i = 0; i <= steps; ++i) stroke.points.push_back(at(static_cast<double>(i) / steps));
  return stroke;
}

/// Smooth noise: white noise, low-passed twice at 3 Hz, of 1 rms.
class Smooth {
 public:
  explicit Smooth(std::uint64_t seed) : random_(seed) {
    for (int i = 0; i < 500; ++i) (void)next();
  }
  Vec3 next() {
    constexpr double kBlend = 2 * pi * 3 * kTick, kGain = 14.4;  // the gain makes the rms 1
    for (int axis = 0; axis < 3; ++axis) {
      once_[axis] += kBlend * (normal_(random_) - once_[axis]);
      twice_[axis] += kBlend * (once_[axis] - twice_[axis]);
    }
    return kGain * twice_;
  }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  Vec3 once_ = Vec3::Zero(), twice_ = Vec3::Zero();
};

/// Where the trainee would be without noise, tick by tick.
class Walk {
 public:
  Walk(const ArcPath& path, const Departure& departure, Trial& trial)
      : path_(path), step_(kTick * kExpertSpeed * departure.speed), trial_(trial) {}

  void along(double to) {
    const double step = to > s_ ? step_ : -step_;
    while (std::abs(to - s_) > step_) put(path_.position_at(s_ + step), s_ + step);
    put(path_.position_at(to), to);
  }
  /// Moves straight to the place `to`; the true place moves evenly.
  void straight(double to) {
    const Vec3 from = path_.position_at(s_), way = path_.position_at(to) - from;
    const double begin = s_;
    const int ticks = std::max(static_cast<int>(way.norm() / step_), 1);
    for (int i = 1; i <= ticks; ++i) {
      const double share = static_cast<double>(i) / ticks;
      put(from + share * way, begin + share * (to - begin));
    }
  }
  void away(const Vec3& way) {
    const Vec3 from = path_.position_at(s_);
    const int ticks = static_cast<int>(2 * way.norm() / step_);
    for (int i = 0; i < ticks; ++i) put(from + (1 - std::abs(2.0 * i / ticks - 1)) * way, s_, true);
  }
  void rest(double time) {
    for (double t = 0; t < time; t += kTick) put(path_.position_at(s_), s_);
  }
  /// Shakes for 20 s at the same place, with a tremor of 5 Hz whose direction drifts.
  void shake(double amplitude, std::mt19937_64& random) {
    constexpr double kTime = 20, kHertz = 5;  // [s]
    Smooth direction(random());
    const Vec3 there = path_.position_at(s_);
    for (double t = 0; t < kTime; t += kTick)
      put(there + amplitude * std::sin(2 * pi * kHertz * t) * direction.next().normalized(), s_);
  }
  void grace(double movement) { grace_ = std::max(grace_, movement); }
  void begin_at(double s) { s_ = s; }
  [[nodiscard]] double place() const { return s_; }

 private:
  void put(const Vec3& hand, double s, bool outside = false) {
    if (!trial_.hand.empty()) grace_ -= (hand - trial_.hand.back()).norm();
    trial_.hand.push_back(hand);
    trial_.truth.push_back(s);
    trial_.grace.push_back(outside || grace_ > 0);
    s_ = s;
  }

  const ArcPath& path_;
  double step_, s_ = 0, grace_ = 0;
  Trial& trial_;
};

/// Low-passes the positions over time, forwards and backwards.
void low_pass(std::vector<Vec3>& hand, double cutoff) {
  const double blend = -std::expm1(-2 * pi * cutoff * kTick);
  const auto once = [&](auto begin, auto end) {
    for (Vec3 now = *begin; begin != end; ++begin) *begin = now += blend * (*begin - now);
  };
  once(hand.begin(), hand.end());
  once(hand.rbegin(), hand.rend());
}

/// Walks along the path with the departures that change the order of places.
void walk_along(const Stroke& stroke, const ArcPath& path, const Departure& departure, std::mt19937_64& random,
                Walk& walk) {
  const double length = path.length();
  std::uniform_real_distribution<double> share(0.25, 0.7);
  const double event = share(random) * length;
  bool happened = false;
  if (departure.middle) {
    walk.begin_at(event);
    walk.grace(kGraceLost);
    happened = true;
  }
  const auto happen = [&] {
    happened = true;
    walk.along(event);
    if (departure.stop > 0) walk.rest(departure.stop);
    if (departure.shake > 0) walk.shake(departure.shake, random);
    if (departure.back > 0) {
      walk.along(event - departure.back);
      walk.along(event);
    }
    if (departure.again) {
      walk.along(0);
      walk.along(event);
    }
    if (departure.skip > 0) {
      walk.straight(std::min(event + departure.skip, length));
      walk.grace(kGraceLost);
    }
    if (departure.wander > 0) {
      const Vec3 tangent = path.at(event).tangent;
      walk.away(departure.wander * Vec3(-tangent.y(), tangent.x(), 2).normalized());
      walk.grace(kGraceLost);
    }
  };
  const double early = departure.early;
  for (const double corner : stroke.corners) {
    if (early <= 0 || corner - early < walk.place() || corner + early > length) continue;
    if (!happened && event < corner + early) happen();
    if (corner - early < walk.place()) continue;
    walk.along(corner - early);
    walk.straight(corner + early);
    walk.grace(kGraceTurn);
  }
  if (!happened) happen();
  walk.along(length);
  walk.rest(0.3);
}

}  // namespace

std::vector<Stroke> strokes() {
  std::vector<Stroke> all;
  all.push_back(polyline("line and back", {{0, 0, 0}, {0.1, 0, 0}, {0, 0, 0}}));
  all.push_back(curve("circle, 3 laps", 6 * pi * 0.04,
                      [](double u) { return Vec3(0.04 * std::cos(6 * pi * u), 0.04 * std::sin(6 * pi * u), 0); }));
  all.push_back(curve("figure eight, 2 laps", 0.55,
                      [](double u) { return Vec3(0.05 * std::sin(4 * pi * u), 0.03 * std::sin(8 * pi * u), 0); }));
  std::vector<Vec3> legs;
  for (int i = 0; i <= 8; ++i) legs.emplace_back(0.012 * i, i % 2 == 0 ? 0 : 0.045, 0);
  all.push_back(polyline("zigzag", legs));
  all.push_back(polyline("square", {{0, 0, 0}, {0.08, 0, 0}, {0.08, 0.08, 0}, {0, 0.08, 0}, {0, 0, 0}}));
  all.push_back(curve("spiral", 0.75, [](double u) {
    const double turn = 5 * 2 * pi * std::sqrt(0.04 + 0.96 * u), r = 8e-3 * turn / (2 * pi);
    return Vec3(r * std::cos(turn), r * std::sin(turn), 0);
  }));
  all.push_back(curve("script", 0.5, [](double u) {
    // Letters of different heights.
    const double letter = 7 * u, height = 0.008 + 0.006 * std::sin(2.4 * letter) * std::sin(1.1 * letter);
    return Vec3(0.1 * u + 0.008 * std::sin(2 * pi * letter), height * (1 - std::cos(2 * pi * letter)), 0);
  }));
  all.push_back(polyline("stretch three times", {{0, 0, 0}, {0.08, 0, 0}, {0, 0, 0}, {0.08, 0, 0}}));
  Stroke hairpin = curve("hairpin", 0.2, [](double u) {
    const double s = u * (0.18 + pi * 1e-3), bend = s - 0.09;
    if (bend < 0) return Vec3(s, 0, 0);
    if (bend < pi * 1e-3) return Vec3(0.09 + 1e-3 * std::sin(bend / 1e-3), 1e-3 - 1e-3 * std::cos(bend / 1e-3), 0);
    return Vec3(0.09 - (bend - pi * 1e-3), 2e-3, 0);
  });
  hairpin.corners = {0.09 + pi * 0.5e-3};
  all.push_back(std::move(hairpin));
  all.push_back(curve("two laps, 2 mm apart", 4 * pi * 0.04, [](double u) {
    const double r = 0.041 - 2e-3 * 2 * u;
    return Vec3(r * std::cos(4 * pi * u), r * std::sin(4 * pi * u), 0);
  }));
  return all;
}

ArcPath path_of(const Stroke& stroke, double radius) {
  ArcPath::Builder builder(2.5e-4);
  double s = 0;
  const auto force = [](double at) { return Vec3(std::cos(40 * at), std::sin(25 * at), 0.5); };
  builder.add(0, stroke.points.front(), force(0));
  for (std::size_t i = 1; i < stroke.points.size(); ++i) {
    const Vec3 from = stroke.points[i - 1], way = stroke.points[i] - from;
    const int steps = std::max(static_cast<int>(std::ceil(way.norm() / kFineStep)), 1);
    for (int k = 1; k <= steps; ++k) {
      const double share = static_cast<double>(k) / steps, at = s + share * way.norm();
      builder.add(at / kExpertSpeed, from + share * way, force(at));
    }
    s += way.norm();
  }
  return builder.finish(radius);
}

Trial trial_of(const Stroke& stroke, const ArcPath& path, const Departure& departure, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> angle(0, 2 * pi);
  Trial trial{.any_lap = departure.middle};
  Walk walk(path, departure, trial);
  walk_along(stroke, path, departure, random, walk);
  if (departure.low_pass > 0) low_pass(trial.hand, departure.low_pass);

  Vec3 least = stroke.points.front(), most = least;
  for (const Vec3& p : stroke.points) least = least.cwiseMin(p), most = most.cwiseMax(p);
  const Vec3 centre = departure.about_start ? stroke.points.front() : Vec3(0.5 * (least + most));
  const double way = angle(random), phase = angle(random), turn = angle(random) < pi ? 1 : -1;
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(turn * departure.rotation, Vec3::UnitZ()).toRotationMatrix();
  const Vec3 shift = departure.shift * Vec3(std::cos(way), std::sin(way), 0);
  const Vec3 shakes = departure.tremor * Vec3(std::cos(phase), std::sin(phase), 0);
  Smooth noise(seed + 1);
  for (std::size_t i = 0; i < trial.hand.size(); ++i) {
    const double t = kTick * static_cast<double>(i);
    trial.hand[i] = centre + departure.scale * (rotation * (trial.hand[i] - centre)) + shift +
                    departure.noise * noise.next() + std::sin(2 * pi * 5 * t + phase) * shakes;
  }
  return trial;
}

Verdict judge(const ArcPath& path, const Trial& trial, bool allow_back) {
  constexpr double kTolerance = 5e-3, kLongest = 0.5, kStrand = 0.015, kSettling = 0.4;  // [m], [s], [m], [s]
  PlaceTracker tracker(path, {.allow_back = allow_back});
  Verdict verdict;
  double wrong = 0, before = 0, squares = 0;
  bool was_right = true, moves = false;
  std::size_t doubtful = 0, counted = 0;
  for (std::size_t i = 0; i < trial.hand.size(); ++i) {
    const double moved = i > 0 ? (trial.hand[i] - trial.hand[i - 1]).norm() : 0;
    const PlaceTracker::Foot& foot = tracker.update(trial.hand[i], i > 0 ? kTick : 0);
    const ArcPath::Place there = path.at(trial.truth[i]);
    const double off = (trial.hand[i] - there.position).norm(), tolerance = kTolerance + 2 * off;
    const double error = std::abs(foot.s - trial.truth[i]);
    const bool same = trial.any_lap && (foot.place.position - there.position).norm() <= tolerance &&
                      foot.place.tangent.dot(there.tangent) > 0.5;
    const bool right = error <= tolerance || same;
    wrong = right || trial.grace[i] ? 0 : wrong + kTick;
    verdict.longest_wrong = std::max(verdict.longest_wrong, wrong);
    // A jump is counted where it ends.
    if (moves && !foot.relocated && was_right && !trial.grace[i] && error - tolerance > kStrand) ++verdict.jumps;
    moves = foot.relocated;
    if (!moves) was_right = right;
    verdict.kept = right;
    const double wall = std::max(foot.tube.distance - foot.tube.radius, 0.0);
    if (kTick * static_cast<double>(i) > kSettling)
      verdict.wrong_wall = std::max(verdict.wrong_wall, wall - std::max(off - there.radius, 0.0));
    doubtful += foot.certainty < 1 ? 1 : 0;
    if (i > 0 && foot.certainty > 0) verdict.fastest = std::max(verdict.fastest, std::abs(foot.s - before) - moved);
    before = foot.s;
    if (!trial.grace[i]) squares += error * error, ++counted;
  }
  verdict.kept = verdict.kept && verdict.longest_wrong <= kLongest;
  verdict.doubt = static_cast<double>(doubtful) / static_cast<double>(trial.hand.size());
  verdict.error = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(counted, 1)));
  return verdict;
}

}  // namespace haptrace::test
