#include "control/design/lqg_search.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/parallel.h"
#include "control/design/nelder_mead.h"
#include "control/design/tracking_design.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <span>
#include <utility>

namespace haptrace {
namespace {

constexpr EnumNames<Firmness, 3> kFirmnessNames{"firmness", {"quiet", "normal", "exact"}};

constexpr double kLater = 0.35e-3;  // [s]
constexpr double kOtherHand = 1.6;  // factor on each of the hand's numbers
constexpr double kUnstable = 30;
constexpr double kModelledTremor = 0.2;  // from which a law has states for it [N]
constexpr double kLearnedNoise = 0.15;   // noise in a learned force, of a plain law's ripple
constexpr double kLearningGain = 0.8;    // of an error in the load that is learned from it
constexpr int kFirstEvaluations = 90, kLastEvaluations = 300;
constexpr double kSpread = 1e-4;       // of the values, below which the search has arrived
constexpr std::size_t kStarts = 9;     // of an axis of which nothing is known
constexpr std::size_t kFewStarts = 3;  // of an axis that is like another
constexpr double kMet = 1.02;          // a requirement counts as met up to this factor

struct Firm {
  double target = 1;  // share of the ripple of the plain law
  LqgNumbers start;
};

Firm firm(Firmness firmness) {
  switch (firmness) {
    case Firmness::quiet:
      return {0.43, {.drift = 0.075, .drift_hz = 0.6, .force_noise = 0.004, .ripple_weight = 1.2e-7}};
    case Firmness::exact:
      return {1.35, {.drift = 0.20, .drift_hz = 1.3, .force_noise = 0.0055, .ripple_weight = 2.2e-8}};
    case Firmness::normal:
      break;
  }
  return {0.9, {}};
}

/// The numbers as the search varies them: without bounds, and each with steps of similar effect.
using Point = std::array<double, 6>;

Point point_of(const LqgNumbers& n) {
  return {std::log(n.drift),         std::log(n.drift_hz), std::log(n.force_noise),
          std::log(n.ripple_weight), n.mass_factor,        n.hand_share};
}

LqgNumbers numbers_of(const Point& point) {
  const auto bounded_exp = [](double x, double least, double most) { return std::clamp(std::exp(x), least, most); };
  return {.drift = bounded_exp(point[0], 1e-4, 1e2),
          .drift_hz = bounded_exp(point[1], 0.05, 20),
          .force_noise = bounded_exp(point[2], 1e-6, 1),
          .ripple_weight = bounded_exp(point[3], 1e-14, 1e-2),
          .mass_factor = std::clamp(point[4], 0.5, 1.5),
          .hand_share = std::clamp(point[5], 0.02, 1.2)};
}

/// Returns the force of the hand: that of a healthy one, with the identified tremor if that is stronger.
HandNoise noise_of(const AxisModel& identified) {
  HandNoise noise = kHealthyHand;
  if (identified.noise.tremor > noise.tremor) {
    noise.tremor = identified.noise.tremor;
    noise.tremor_hz = identified.noise.tremor_hz;
  }
  return noise;
}

double excess(double value, double bound) {
  return std::max(0.0, std::log(value / bound));
}

/// One axis of the search: its plants, and the value of a law on them.
class AxisSearch {
 public:
  AxisSearch(const AxisModel& identified, const LqgSearchOptions& options)
      : identified_(identified),
        start_(firm(options.firmness).start),
        plain_(options.plain_ripple > 0 ? options.plain_ripple
                                        : identified.position_noise * plain_ripple(identified.rate_hz)),
        target_(firm(options.firmness).target * plain_),
        grid_(identified.rate_hz) {
    identified_.noise = noise_of(identified);
    identified_.force_noise = 0;
    nominal_ = discretised(identified_);
    const auto plant = [&](std::string name, const auto& change) {
      AxisModel model = identified_;
      change(model);
      const DiscreteAxis axis = discretised(model);
      return Plant{std::move(name), axis, grid_.plant(axis)};
    };
    const auto scaled = [&](const char* name, double HandModel::*part) {
      for (const double factor : {kOtherHand, 1 / kOtherHand})
        near_.push_back(plant(fmt::format("{} of the hand times {:.2g}", name, factor),
                              [&](AxisModel& m) { m.hand.*part *= factor; }));
    };
    const double later = kLater * identified.rate_hz;
    near_.push_back(plant("the identified plant", [](AxisModel&) {}));
    for (const double mass : {options.lighter, options.heavier})
      near_.push_back(plant(fmt::format("the mass times {:.2g}", mass), [&](AxisModel& m) { m.mass *= mass; }));
    near_.push_back(plant("a later force", [&](AxisModel& m) { m.delay_ticks += later; }));
    scaled("the mass", &HandModel::mass);
    scaled("the stiffness", &HandModel::grip_stiffness);
    scaled("the damping", &HandModel::grip_damping);
    far_.push_back(plant("no hand", [](AxisModel& m) { m.hand = {}; }));
    far_.push_back(plant("a loose hand", [](AxisModel& m) { m.hand = kLooseHand; }));
    far_.push_back(plant("a firm hand", [](AxisModel& m) { m.hand = kFirmHand; }));
    const auto hand_at = [&](const char* name, double mass) {
      if (mass == 1) return;
      far_.push_back(plant(name, [&](AxisModel& m) {
        m.hand.mass /= mass;
        m.hand.grip_stiffness /= mass;
        m.hand.grip_damping /= mass;
        m.hand.arm_stiffness /= mass;
        m.hand.arm_damping /= mass;
      }));
    };
    hand_at("the hand where the device is lightest", options.least);
    hand_at("the hand where the device is heaviest", options.most);
    far_.push_back(plant("no hand and a lighter device", [&](AxisModel& m) {
      m.hand = {};
      m.mass *= options.lighter;
    }));
    far_.push_back(plant("no hand and a later force", [&](AxisModel& m) {
      m.hand = {};
      m.delay_ticks += later;
    }));
  }

  /// Returns start `index` of kStarts: three shares of the hand, each with three sizes of the noise.
  [[nodiscard]] Point start(std::size_t index) const {
    constexpr std::array<double, 3> kShares{0.5, 0.25, 1}, kNoises{1, 0.5, 2};
    LqgNumbers numbers = start_;
    numbers.hand_share = kShares[index % 3];
    numbers.drift *= kNoises[index / 3];
    numbers.force_noise *= kNoises[index / 3];
    return on_target(numbers);
  }

  /// Returns the point of `numbers`, but with the weight of the ripple that meets the target.
  [[nodiscard]] Point on_target(const LqgNumbers& numbers) const {
    Point point = point_of(numbers);
    // The ripple falls as its weight grows.
    double low = std::log(1e-12), high = std::log(1e-3);
    for (int i = 0; i < 12; ++i) {
      point[3] = 0.5 * (low + high);
      const auto law = design(point);
      const auto figures = law ? LqgLoop(*law, nominal_).figures() : std::nullopt;
      (figures && figures->ripple > target_ ? low : high) = point[3];
    }
    return point;
  }

  [[nodiscard]] Point followed(const Point& from, int evaluations) const {
    constexpr Point kSteps{0.4, 0.4, 0.4, 0.4, 0.08, 0.15};
    return minimised([&](const Point& point) { return value(point); }, from, kSteps, evaluations, kSpread);
  }

  [[nodiscard]] double value(const Point& point) const {
    const auto law = design(point);
    if (!law) return 2 * kUnstable;
    const auto figures = LqgLoop(*law, nominal_).figures();
    if (!figures) return 2 * kUnstable;
    const FrequencyGrid::Response response = grid_.law(*law), model = grid_.plant(law->model);
    int unstable = 0;
    for (const auto* plants : {&near_, &far_})
      for (const Plant& plant : *plants) unstable += !FrequencyGrid::stable_like(model, plant.response, response);
    if (unstable > 0) return kUnstable + unstable;
    return std::log(1e3 * figures->error) + 20 * excess(figures->ripple, target_) +
           5 * excess(sensitivity(near_, response), kNearSensitivity) +
           5 * excess(sensitivity(far_, response), kFarSensitivity);
  }

  /// Returns the law of a point of finite value, checked by its poles.
  [[nodiscard]] LqgResult result(const Point& point) const {
    LqgResult result{.numbers = numbers_of(point), .ripple_target = target_};
    const auto laws = lqg_laws(identified_, result.numbers, plain_);
    if (!laws) throw input_error("the search found no law: the model of the axis cannot be controlled");
    result.laws = *laws;
    const LqgAxis &law = result.laws.moving, &resting = result.laws.resting;
    const FrequencyGrid::Response response = grid_.law(law);
    result.near_sensitivity = sensitivity(near_, response);
    result.far_sensitivity = sensitivity(far_, response);
    for (const auto* plants : {&near_, &far_})
      for (const Plant& plant : *plants)
        for (const auto& [of, when] : {std::pair{&law, "unstable"}, {&resting, "unstable at rest"}})
          if (!(LqgLoop(*of, plant.axis).radius() < 1))
            result.unmet.push_back(fmt::format("it is {} with {}", when, plant.name));
    if (const auto figures = LqgLoop(law, nominal_).figures()) result.figures = *figures;
    const auto require = [&](const char* what, double value, double bound) {
      if (!(value <= kMet * bound))
        result.unmet.push_back(fmt::format("{} is {:.3g}, above {:.3g}", what, value, bound));
    };
    require("its ripple [N]", result.figures.ripple, target_);
    require("its sensitivity near the identified plant", result.near_sensitivity, kNearSensitivity);
    require("its sensitivity with other hands", result.far_sensitivity, kFarSensitivity);
    return result;
  }

 private:
  struct Plant {
    std::string name;
    DiscreteAxis axis;
    FrequencyGrid::Response response;
  };

  [[nodiscard]] std::optional<LqgAxis> design(const Point& point) const {
    return design_lqg(identified_, numbers_of(point));
  }

  static double sensitivity(const std::vector<Plant>& plants, const FrequencyGrid::Response& law) {
    double largest = 0;
    for (const Plant& plant : plants)
      largest = std::max(largest, FrequencyGrid::largest_sensitivity(plant.response, law));
    return largest;
  }

  AxisModel identified_;
  LqgNumbers start_;
  double plain_, target_;  // ripple [N]
  FrequencyGrid grid_;
  DiscreteAxis nominal_;
  std::vector<Plant> near_, far_;
};

}  // namespace

const char* to_string(Firmness firmness) noexcept {
  return kFirmnessNames.name(firmness);
}

Firmness parse_firmness(std::string_view name) {
  return kFirmnessNames.parse(name);
}

std::optional<LqgAxis> design_lqg(const AxisModel& identified, const LqgNumbers& numbers) {
  AxisModel model = identified;
  model.mass *= numbers.mass_factor;
  model.hand.mass *= numbers.hand_share;
  model.hand.grip_stiffness *= numbers.hand_share;
  model.hand.grip_damping *= numbers.hand_share;
  model.noise.drift = numbers.drift;
  model.noise.drift_hz = numbers.drift_hz;
  if (model.noise.tremor < kModelledTremor) model.noise.tremor = 0;
  model.force_noise = numbers.force_noise;
  return design_lqg(model, numbers.ripple_weight);
}

std::optional<LqgAxis> design_lqg_for_rest(const AxisModel& identified, double max_ripple) {
  constexpr double kForceNoise = 0.25;  // [N sqrt(s) / kg]
  AxisModel model = identified;
  model.hand = {};
  model.noise = {.drift = 0.2, .drift_hz = 1};
  model.force_noise = kForceNoise * model.mass;
  AxisModel held = identified;
  held.noise = kHealthyHand;
  held.force_noise = 0;
  const DiscreteAxis plant = discretised(held);
  std::optional<LqgAxis> law;
  double low = std::log(1e-12), high = std::log(1e-2);  // of the weight of the ripple
  for (int i = 0; i < 20; ++i) {
    const double weight = 0.5 * (low + high);
    law = design_lqg(model, std::exp(weight));
    if (!law) return std::nullopt;
    const auto figures = LqgLoop(*law, plant).figures();
    (!figures || figures->ripple > max_ripple ? low : high) = weight;
  }
  return law;
}

double learning_bandwidth(const AxisModel& identified, const LqgAxis& law, double max_noise) {
  AxisModel free = identified;
  free.hand = {};
  free.link = {};
  const FrequencyGrid grid(identified.rate_hz);
  const auto held = grid.plant(discretised(identified)), alone = grid.plant(discretised(free)),
             feedback = grid.law(law);
  // The integral of (2 pi f)^4 up to the bandwidth, over white noise up to half the rate.
  const auto learned_noise = [&](double frequency) {
    const double w = 2 * std::numbers::pi * frequency;
    return identified.mass * w * w * identified.position_noise * std::sqrt(2 * frequency / (5 * identified.rate_hz));
  };
  double bandwidth = kLeastLearning;
  for (std::size_t i = 0; i < held.size() && grid.frequency(i) <= kMostLearning; ++i) {
    const double frequency = grid.frequency(i);
    const double gain = std::abs((1.0 - held[i] / alone[i]) / (1.0 + held[i] * feedback[i]));
    if (frequency > kLeastLearning && (gain > kLearningGain || learned_noise(frequency) > max_noise)) break;
    bandwidth = std::max(bandwidth, frequency);
  }
  return bandwidth;
}

std::optional<LqgLaws> lqg_laws(const AxisModel& identified, const LqgNumbers& numbers, double plain_ripple) {
  const auto moving = design_lqg(identified, numbers);
  const auto resting = design_lqg_for_rest(identified, firm(Firmness::normal).target * plain_ripple);
  if (!moving || !resting) return std::nullopt;
  return LqgLaws{*moving, *resting, learning_bandwidth(identified, *moving, kLearnedNoise * plain_ripple)};
}

namespace {

/// Searches of several axes, of which the first leads: the axes of a device in a hand are alike.
class LqgSearches {
 public:
  using Results = std::array<std::optional<LqgResult>, 3>;

  LqgSearches(const std::array<std::optional<AxisModel>, 3>& identified, const LqgSearchOptions& options,
              const StopRequest& stop, const std::function<void(double)>& progress)
      : options_(options), stop_(stop), progress_(progress) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (identified[axis]) axes_.push_back({axis, AxisSearch(*identified[axis], options), options.like});
  }

  /// Returns nothing if it was stopped.
  std::optional<Results> run() {
    if (axes_.empty()) return Results{};
    jobs_ = jobs_of(options_.like ? kFewStarts : kStarts) + static_cast<double>(axes_.size() - 1) * jobs_of(kFewStarts);
    const std::span<Axis> all = axes_;
    if (!search(all.first(1))) return std::nullopt;
    for (Axis& axis : all.subspan(1)) axis.like = numbers_of(all[0].best);
    if (axes_.size() > 1 && !search(all.subspan(1))) return std::nullopt;
    Results results;
    for (const Axis& axis : axes_) results[axis.axis] = axis.search.result(axis.best);
    return results;
  }

 private:
  struct Axis {
    std::size_t axis;
    AxisSearch search;
    std::optional<LqgNumbers> like;
    std::vector<Point> found{};  ///< from every start
    std::vector<double> value{};
    Point best{};
  };

  // The last search of an axis takes about as long as two of the first.
  static double jobs_of(std::size_t starts) { return static_cast<double>(starts + 2); }

  void report(double done) const {
    if (progress_) progress_((before_ + done) / jobs_);
  }

  bool search(std::span<Axis> group) { return search_from_starts(group) && polish_best(group); }

  bool search_from_starts(std::span<Axis> group) {
    std::vector<std::pair<Axis*, std::size_t>> starts;
    for (Axis& axis : group) {
      axis.found.resize(axis.like ? kFewStarts : kStarts);
      axis.value.resize(axis.found.size());
      for (std::size_t start = 0; start < axis.found.size(); ++start) starts.emplace_back(&axis, start);
    }
    const bool whole = run_parallel(
        starts.size(), options_.threads, stop_,
        [&](std::size_t job) {
          const auto& [axis, start] = starts[job];
          const AxisSearch& own = axis->search;
          const Point from = start == 0 && axis->like ? own.on_target(*axis->like) : own.start(start);
          axis->found[start] = own.followed(from, kFirstEvaluations);
          axis->value[start] = own.value(axis->found[start]);
        },
        [&](std::size_t done) { report(static_cast<double>(done)); });
    if (whole) before_ += static_cast<double>(starts.size());
    return whole;
  }

  bool polish_best(std::span<Axis> group) {
    const bool whole = run_parallel(
        group.size(), options_.threads, stop_,
        [&](std::size_t job) {
          Axis& axis = group[job];
          const auto best = std::min_element(axis.value.begin(), axis.value.end()) - axis.value.begin();
          axis.best = axis.search.followed(axis.found[static_cast<std::size_t>(best)], kLastEvaluations);
        },
        [&](std::size_t done) { report(2 * static_cast<double>(done)); });
    before_ += 2 * static_cast<double>(group.size());
    return whole;
  }

  const LqgSearchOptions& options_;
  const StopRequest& stop_;
  const std::function<void(double)>& progress_;
  std::vector<Axis> axes_;
  double jobs_ = 0, before_ = 0;  ///< all jobs, and those that are done
};

}  // namespace

std::optional<std::array<std::optional<LqgResult>, 3>> search_lqg(
    const std::array<std::optional<AxisModel>, 3>& identified, const LqgSearchOptions& options, const StopRequest& stop,
    const std::function<void(double)>& progress) {
  return LqgSearches(identified, options, stop, progress).run();
}

}  // namespace haptrace
