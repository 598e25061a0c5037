#include "studies/stability_map.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/parallel.h"
#include "control/pd.h"
#include "control/velocity_estimator.h"
#include "devices/sim/sim_device.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace haptrace {
namespace {

using nlohmann::json;
using std::numbers::pi;

constexpr std::size_t kAtOnce = 3;  // pairs of gains in one simulation, one per axis

/// Returns `plant` with all three axes equal to `axis`, without coupling or gravity.
PlantModel alike(const PlantModel& plant, int axis) {
  PlantModel like;
  like.mass = Vec3::Constant(plant.mass[axis]);
  like.viscous = Vec3::Constant(plant.viscous[axis]);
  like.coulomb = Vec3::Constant(plant.coulomb[axis]);
  like.delay = plant.delay;
  like.position_resolution = plant.position_resolution;
  return like;
}

LoopModel loop_of(const PlantModel& plant, int axis, const StabilityOptions& options) {
  LoopModel loop = loop_of(plant, axis, options.rate_hz, options.velocity, options.lag);
  loop.observer = options.observer;
  return loop;
}

/// Time-domain simulation of ObserverModel.
class Observer {
 public:
  Observer(const ObserverModel& model, double delay, double period)
      : g_mass_(2 * pi * model.bandwidth_hz * model.nominal_mass),
        gain_(-std::expm1(-2 * pi * model.bandwidth_hz * period)),
        part_(std::max(delay / period - std::floor(delay / period + 1e-9), 0.0)),
        sent_(static_cast<std::size_t>(std::floor(delay / period + 1e-9)) + 2, Vec3::Zero()) {}

  /// Returns the force that cancels the plant's load.
  Vec3 load(const Vec3& velocity) {
    const Vec3 applied = (1 - part_) * sent_[sent_.size() - 2] + part_ * sent_.back();
    low_ += gain_ * (applied + g_mass_ * velocity - low_);
    return low_ - g_mass_ * velocity;
  }
  void sent(const Vec3& force) {
    std::rotate(sent_.begin(), sent_.end() - 1, sent_.end());
    sent_.front() = force;
  }

 private:
  double g_mass_, gain_, part_;
  std::vector<Vec3> sent_;  ///< newest first
  Vec3 low_ = Vec3::Zero();
};

/// Closed loops of three pairs of gains on three equal axes, in virtual time.
class GainTrial {
 public:
  GainTrial(const PlantModel& plant, const std::array<AxisGains, kAtOnce>& gains, const StabilityOptions& options)
      : period_(1 / options.rate_hz),
        device_(spec_of(plant, options), {.longest_step = integration_step(plant, options)}),
        gains_(law_of(gains)) {
    if (options.observer) observer_.emplace(*options.observer, plant.delay, period_);
  }

  /// Runs one tick. `push`: force in addition to the law's [N].
  void step(VelocityEstimator& estimator, const Vec3& reference, double push) {
    DeviceState measured;
    (void)device_.exchange({force_, Vec3::Zero()}, first_ ? 0 : period_, measured);
    first_ = false;
    State state;
    state.position = measured.position.cwiseProduct(held_);
    state.velocity = estimator.update(state.position, period_);
    force_ = pd_force(gains_, state, {.position = reference, .velocity = Vec3::Zero(), .acceleration = Vec3::Zero()}) +
             Vec3::Constant(push);
    if (observer_) force_ += observer_->load(state.velocity);
    force_ = force_.cwiseProduct(held_);
    if (observer_) observer_->sent(force_);
  }

  /// Removes force and measurement of this axis, so that diverging values cannot affect the other axes.
  void let_go(int axis) { held_[axis] = 0; }

  [[nodiscard]] Vec3 position() const { return device_.true_position(); }
  [[nodiscard]] Vec3 velocity() const { return device_.true_velocity(); }

 private:
  static SimSpec spec_of(const PlantModel& plant, const StabilityOptions& options) {
    SimSpec spec = sim_spec_of(plant, 1e12, options.lag);
    spec.workspace = {Vec3::Constant(-1e9), Vec3::Constant(1e9)};
    // Semi-implicit Euler computes positions half a step early, which would shorten the delay by as much.
    spec.delay += integration_step(plant, options) / 2;
    return spec;
  }

  /// Returns a sixtieth of the loop's delay, at most a tenth of a period [s].
  static double integration_step(const PlantModel& plant, const StabilityOptions& options) {
    const double period = 1 / options.rate_hz;
    return std::min((period / 2 + plant.delay) / 60, period / 10);
  }

  static PdGains law_of(const std::array<AxisGains, kAtOnce>& gains) {
    PdGains law;
    for (int i = 0; i < 3; ++i) {
      law.kp[i] = gains[static_cast<std::size_t>(i)].kp;
      law.kd[i] = gains[static_cast<std::size_t>(i)].kd;
    }
    return law;
  }

  double period_;
  SimDevice device_;
  PdGains gains_;
  std::optional<Observer> observer_;
  Vec3 force_ = Vec3::Zero();
  Vec3 held_ = Vec3::Ones();  ///< 0 for a removed axis
  bool first_ = true;
};

enum class Verdict : std::uint8_t { open, stable, unstable };

/// Judges one axis from its motion in successive windows.
class Judge {
 public:
  Judge(bool fully, double mass, double kp, double kick, double resolution)
      : fully_(fully), mass_(mass), kp_(kp), kick_(kick), calm_(std::max(2 * resolution, kick / 20)) {}

  void see(double x, double v) {
    constexpr double kRuined = 1e3;
    if (decided()) return;
    if (!(std::abs(x) <= kRuined * kick_)) verdict_ = Verdict::unstable;
    energy_ += mass_ * v * v + kp_ * x * x;
    low_ = std::min(low_, x);
    high_ = std::max(high_, x);
  }

  void end_window() {
    constexpr double kGrown = 1e4;
    const double size = fully_ ? high_ - low_ : energy_;
    if (!decided() && windows_ > 0) {
      if (!fully_ && !(size <= kGrown * first_)) verdict_ = Verdict::unstable;
      if (size <= (fully_ ? calm_ : first_ / kGrown)) verdict_ = Verdict::stable;
      grows_ = fully_ ? size > 0.97 * last_ : size > last_;
    }
    if (windows_++ == 0) first_ = size;
    last_ = size;
    energy_ = 0;
    low_ = std::numeric_limits<double>::infinity();
    high_ = -low_;
  }

  [[nodiscard]] bool decided() const { return verdict_ != Verdict::open; }
  [[nodiscard]] bool ruined() const { return verdict_ == Verdict::unstable; }
  [[nodiscard]] bool stable() const { return verdict_ == Verdict::stable || (!decided() && !grows_); }

 private:
  bool fully_;
  double mass_, kp_, kick_, calm_;
  double energy_ = 0, low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
  double first_ = 0, last_ = 0;
  int windows_ = 0;
  bool grows_ = true;
  Verdict verdict_ = Verdict::open;
};

/// Returns the window: two undamped periods of the softest pair [ticks].
int window_of(double mass, const std::array<AxisGains, kAtOnce>& gains, double rate_hz) {
  double softest = std::numeric_limits<double>::infinity();
  for (const AxisGains& g : gains) softest = std::min(softest, g.kp);
  return static_cast<int>(std::clamp(2 * 2 * pi * std::sqrt(mass / softest) * rate_hz, 100.0, 2e4));
}

// --- Map ------------------------------------------------------------------------------------------------------------

std::vector<double> even_ratios(double low, double high, std::size_t count) {
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i)
    values.push_back(low * std::pow(high / low, static_cast<double>(i) / static_cast<double>(count - 1)));
  return values;
}

/// Returns the axis with the smallest modulus margin.
int worst_axis(const PlantModel& plant, const PdGains& gains, const StabilityOptions& options) {
  int worst = 0;
  double least = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const LoopAnalysis analysis(loop_of(plant, axis, options));
    const double modulus = analysis.margins(gains.kp[axis], gains.kd[axis]).modulus;
    if (modulus < least) least = modulus, worst = axis;
  }
  return worst;
}

void choose_grid(StabilityMap& map, const LoopAnalysis& analysis, const StabilityOptions& options) {
  const LoopModel& loop = map.loop;
  const double inertia = loop.mass * loop.rate_hz;  // m / T: the scale of kd
  const double most = analysis.most_damped(1e-6 * inertia * loop.rate_hz);
  double kd_high = 1.3 * (most > 0 ? most : inertia), kd_low = kd_high / 400;
  const auto hold = [](double present, double& low, double& high) {
    high = std::max(high, 1.2 * present);
    if (present > 0) low = std::min(low, present / 1.5);
  };
  hold(map.present.kd, kd_low, kd_high);
  map.kd = even_ratios(kd_low, kd_high, options.kd_cells);

  double stiffest = 0;
  for (const double kd : map.kd) {
    map.boundaries.push_back({.stable = analysis.stiffest(kd)});
    stiffest = std::max(stiffest, map.boundaries.back().stable);
  }
  double kp_high = 1.5 * (stiffest > 0 ? stiffest : inertia * loop.rate_hz), kp_low = kp_high / 1500;
  hold(map.present.kp, kp_low, kp_high);
  map.kp = even_ratios(kp_low, kp_high, options.kp_cells);
}

/// All simulations and searches, as jobs that write to separate places.
class Mapper {
 public:
  Mapper(StabilityMap& map, const PlantModel& plant, const LoopAnalysis& analysis, const StabilityOptions& options)
      : map_(map), plant_(plant), analysis_(analysis), options_(options) {
    map_.cells.resize(map_.kp.size() * map_.kd.size());
  }

  [[nodiscard]] std::size_t cell_jobs() const { return (map_.cells.size() + kAtOnce - 1) / kAtOnce; }
  [[nodiscard]] std::size_t column_jobs() const { return (map_.kd.size() + kAtOnce - 1) / kAtOnce; }

  void fill_cells(std::size_t job) {
    std::array<AxisGains, kAtOnce> gains;
    for (std::size_t i = 0; i < kAtOnce; ++i) gains[i] = gains_of(std::min(kAtOnce * job + i, map_.cells.size() - 1));
    const auto simulated = simulate_stability(plant_, map_.axis, gains, options_, false),
               fully = simulate_stability(plant_, map_.axis, gains, options_, true);
    for (std::size_t i = 0; i < kAtOnce && kAtOnce * job + i < map_.cells.size(); ++i)
      map_.cells[kAtOnce * job + i] = {analysis_.passive(gains[i].kp, gains[i].kd),
                                       analysis_.stable(gains[i].kp, gains[i].kd), simulated[i], fully[i]};
  }

  /// Refines the boundaries of some columns. All cells must be filled.
  void refine_columns(std::size_t job) {
    const auto in_simulation = [&](bool fully) {
      return [this, fully](const std::array<AxisGains, kAtOnce>& gains) {
        return simulate_stability(plant_, map_.axis, gains, options_, fully);
      };
    };
    refine(job, &StabilityCell::simulated, &StabilityBoundary::simulated, in_simulation(false));
    refine(job, &StabilityCell::simulated_fully, &StabilityBoundary::simulated_fully, in_simulation(true));
    refine(job, &StabilityCell::passive, &StabilityBoundary::passive, [this](const auto& gains) {
      std::array<bool, kAtOnce> passive{};
      for (std::size_t i = 0; i < kAtOnce; ++i) passive[i] = analysis_.passive(gains[i].kp, gains[i].kd);
      return passive;
    });
  }

 private:
  [[nodiscard]] AxisGains gains_of(std::size_t cell) const {
    return {map_.kp[cell % map_.kp.size()], map_.kd[cell / map_.kp.size()]};
  }

  /// Bisects between the highest cell of a column that holds and the next one.
  template <class Test>
  void refine(std::size_t job, bool StabilityCell::*holds, double StabilityBoundary::*boundary, const Test& test) {
    constexpr double kFine = 1.003;
    const std::size_t rows = map_.kp.size();
    std::array<double, kAtOnce> low{}, high{};
    std::array<AxisGains, kAtOnce> gains{};
    for (std::size_t i = 0; i < kAtOnce; ++i) {
      const std::size_t column = std::min(kAtOnce * job + i, map_.kd.size() - 1);
      std::size_t above = rows;
      while (above > 0 && !(map_.cells[column * rows + above - 1].*holds)) --above;
      low[i] = above > 0 ? map_.kp[above - 1] : 0;
      high[i] = above > 0 && above < rows ? map_.kp[above] : low[i];
      gains[i].kd = map_.kd[column];
    }
    const auto open = [&](std::size_t i) { return high[i] > kFine * low[i]; };
    while (open(0) || open(1) || open(2)) {
      for (std::size_t i = 0; i < kAtOnce; ++i) gains[i].kp = open(i) ? std::sqrt(low[i] * high[i]) : map_.kp.back();
      const auto held = test(gains);
      for (std::size_t i = 0; i < kAtOnce; ++i)
        if (open(i)) (held[i] ? low[i] : high[i]) = gains[i].kp;
    }
    for (std::size_t i = 0; i < kAtOnce && kAtOnce * job + i < map_.kd.size(); ++i) {
      const bool above_map = map_.cells[(kAtOnce * job + i) * rows + rows - 1].*holds;
      map_.boundaries[kAtOnce * job + i].*boundary = above_map ? kNaN : low[i];
    }
  }

  StabilityMap& map_;
  const PlantModel& plant_;
  const LoopAnalysis& analysis_;
  const StabilityOptions& options_;
};

void check(const PdGains& gains, const StabilityOptions& options) {
  validate(gains);
  if (!(options.rate_hz >= kLowestRate && options.rate_hz <= kHighestRate))
    throw input_error(fmt::format("stability map: the rate is {} Hz; it must be from {} to {} Hz", options.rate_hz,
                                  kLowestRate, kHighestRate));
  if (options.axis && (*options.axis < 0 || *options.axis > 2))
    throw input_error(fmt::format("stability map: the axis is {}; it must be 0, 1 or 2", *options.axis));
  for (const std::size_t cells : {options.kp_cells, options.kd_cells})
    if (cells < 2 || cells > 400)
      throw input_error(fmt::format("stability map: {} cells; there must be 2 to 400 along kp and kd", cells));
  if (!(options.kick > 0 && options.kick <= 1))
    throw input_error(fmt::format("stability map: the kick is {} m; it must be above 0 and at most 1 m", options.kick));
}

// --- JSON and plot --------------------------------------------------------------------------------------------------

Series boundary_line(const StabilityMap& map, double StabilityBoundary::*which, const char* label, int color,
                     bool dashed) {
  Series line{.label = label, .color = color, .dashed = dashed, .width = 1.6};
  for (std::size_t i = 0; i < map.kd.size(); ++i) {
    const double kp = map.boundaries[i].*which;
    if (kp == 0 && (line.y.empty() || !(line.y.back() > 0))) continue;  // a line ends where it reaches zero
    line.x.push_back(map.kd[i]);
    line.y.push_back(kp);
  }
  return line;
}

Series dot(const AxisGains& gains, const std::string& label, int color) {
  return {.label = label, .x = {gains.kd}, .y = {gains.kp}, .color = color, .width = 2.5};
}

Panel panel_of(const StabilityMap& map, std::string title, double kd_high, double kp_high) {
  Panel panel;
  panel.title = std::move(title);
  panel.x_label = "kd (N s/m)";
  panel.y_label = "largest kp (N/m)";
  panel.series = {boundary_line(map, &StabilityBoundary::stable, "stable", 0, false),
                  boundary_line(map, &StabilityBoundary::simulated, "simulated", 4, true),
                  boundary_line(map, &StabilityBoundary::simulated_fully, "with friction", 2, true),
                  boundary_line(map, &StabilityBoundary::passive, "passive", 3, false), dot(map.present, "present", 7)};
  if (map.suggested.kp > 0) panel.series.push_back(dot(map.suggested, "suggested", 1));
  panel.x_range = {0, kd_high};
  panel.y_range = {0, kp_high};
  return panel;
}

}  // namespace

std::array<bool, kAtOnce> simulate_stability(const PlantModel& plant, int axis,
                                             const std::array<AxisGains, kAtOnce>& gains,
                                             const StabilityOptions& options, bool fully) {
  constexpr int kWindows = 10;
  PlantModel model = alike(plant, axis);
  // In motions far below its resolution, foaw keeps its longest window, as in the analysis.
  const auto estimator = make_velocity_estimator(options.velocity, options.rate_hz, model.position_resolution);
  if (!fully) {
    model.coulomb.setZero();
    model.position_resolution = 0;
  }
  GainTrial trial(model, gains, options);
  // Without friction and position resolution the scale of the motion is arbitrary. It is chosen so that the motion
  // stays within foaw's band until it is judged.
  const double small = 1e-12 * (plant.position_resolution > 0 ? plant.position_resolution : 1e-5);
  const double mass = model.mass.x(), push = fully ? 0 : small * mass * options.rate_hz * options.rate_hz;
  const double reference = fully ? options.kick : 0;
  std::vector<Judge> judges;
  for (const AxisGains& g : gains)
    judges.emplace_back(fully, mass, g.kp, fully ? options.kick : 1e8 * small, model.position_resolution);
  // Fills the estimator's memory with rest before the motion starts.
  for (int k = 0; k < 512; ++k) estimator->update(Vec3::Zero(), 1 / options.rate_hz);
  trial.step(*estimator, Vec3::Constant(reference), push);
  const int window = window_of(mass, gains, options.rate_hz);
  const auto decided = [](const Judge& judge) { return judge.decided(); };
  for (int w = 0; w < kWindows && !std::all_of(judges.begin(), judges.end(), decided); ++w) {
    for (int k = 0; k < window; ++k) {
      trial.step(*estimator, Vec3::Constant(reference), 0);
      const Vec3 x = trial.position(), v = trial.velocity();
      for (int i = 0; i < 3; ++i) {
        Judge& judge = judges[static_cast<std::size_t>(i)];
        judge.see(x[i], v[i]);
        if (judge.ruined()) trial.let_go(i);
      }
    }
    for (Judge& judge : judges) judge.end_window();
  }
  return {judges[0].stable(), judges[1].stable(), judges[2].stable()};
}

std::optional<StabilityMap> stability_map(const PlantModel& plant, const PdGains& gains,
                                          const StabilityOptions& options, const StopRequest& stop,
                                          const std::function<void(double)>& progress) {
  check(gains, options);
  StabilityMap map;
  map.axis = options.axis ? *options.axis : worst_axis(plant, gains, options);
  map.loop = loop_of(plant, map.axis, options);
  map.coulomb = plant.coulomb[map.axis];
  map.present = {gains.kp[map.axis], gains.kd[map.axis]};
  map.floor = options.floor;
  const LoopAnalysis analysis(map.loop);
  map.margins = analysis.margins(map.present.kp, map.present.kd);
  map.suggested = analysis.stiffest_pair(options.floor);
  choose_grid(map, analysis, options);

  Mapper mapper(map, plant, analysis, options);
  // Bisecting a column takes about as long as filling it.
  const auto tell = [&](double first, double share, std::size_t jobs) {
    return [&progress, first, share, jobs](std::size_t done) {
      if (progress) progress(first + share * static_cast<double>(done) / static_cast<double>(jobs));
    };
  };
  if (!run_parallel(
          mapper.cell_jobs(), options.threads, stop, [&](std::size_t job) { mapper.fill_cells(job); },
          tell(0, 0.5, mapper.cell_jobs())) ||
      !run_parallel(
          mapper.column_jobs(), options.threads, stop, [&](std::size_t job) { mapper.refine_columns(job); },
          tell(0.5, 0.5, mapper.column_jobs())))
    return std::nullopt;

  const AxisGains& p = map.present;
  map.at_present = {analysis.passive(p.kp, p.kd), analysis.stable(p.kp, p.kd)};
  if (p.kp > 0) {
    map.at_present.simulated = simulate_stability(plant, map.axis, {p, p, p}, options, false)[0];
    map.at_present.simulated_fully = simulate_stability(plant, map.axis, {p, p, p}, options, true)[0];
  }
  return map;
}

json to_json(const Margins& margins) {
  return {{"gain_up", json_of_number(margins.gain_up)},
          {"gain_down", json_of_number(margins.gain_down)},
          {"phase_deg", json_of_number(margins.phase * 180 / pi)},
          {"delay_s", json_of_number(margins.delay)},
          {"modulus", json_of_number(margins.modulus)}};
}

json to_json(const StabilityMap& map) {
  const auto to_words = [](const StabilityCell& cell) {
    return json{{"passive", cell.passive},
                {"stable", cell.stable},
                {"simulated", cell.simulated},
                {"simulated_fully", cell.simulated_fully}};
  };
  json result = {{"axis", std::string(1, "xyz"[map.axis])},
                 {"plant",
                  {{"mass", map.loop.mass},
                   {"viscous", map.loop.viscous},
                   {"coulomb", map.coulomb},
                   {"delay_s", map.loop.delay},
                   {"lag_s", map.loop.lag},
                   {"resolution", map.loop.resolution}}},
                 {"rate_hz", map.loop.rate_hz},
                 {"velocity", map.loop.velocity},
                 {"present", to_words(map.at_present)},
                 {"floor", {{"modulus", map.floor.modulus}, {"gain", map.floor.gain}}},
                 {"suggested", {{"kp", map.suggested.kp}, {"kd", map.suggested.kd}}},
                 {"kp", map.kp},
                 {"kd", map.kd}};
  result["present"]["kp"] = map.present.kp;
  result["present"]["kd"] = map.present.kd;
  result["present"]["margins"] = to_json(map.margins);
  if (map.loop.observer)
    result["observer"] = {{"bandwidth_hz", map.loop.observer->bandwidth_hz},
                          {"nominal_mass", map.loop.observer->nominal_mass}};
  for (const auto& [name, which] :
       {std::pair{"passive", &StabilityBoundary::passive}, std::pair{"stable", &StabilityBoundary::stable},
        std::pair{"simulated", &StabilityBoundary::simulated},
        std::pair{"simulated_fully", &StabilityBoundary::simulated_fully}})
    for (const StabilityBoundary& boundary : map.boundaries)
      result["largest_kp"][name].push_back(json_of_number(boundary.*which));
  for (const auto& [name, which] :
       {std::pair{"passive", &StabilityCell::passive}, std::pair{"stable", &StabilityCell::stable},
        std::pair{"simulated", &StabilityCell::simulated},
        std::pair{"simulated_fully", &StabilityCell::simulated_fully}})
    for (std::size_t column = 0; column < map.kd.size(); ++column) {
      json cells = json::array();
      for (std::size_t row = 0; row < map.kp.size(); ++row)
        cells.push_back(map.cells[column * map.kp.size() + row].*which);
      result["cells"][name].push_back(std::move(cells));
    }
  return result;
}

Figure figure_of(const StabilityMap& map) {
  double stiffest = map.present.kp;
  for (const StabilityBoundary& boundary : map.boundaries) stiffest = std::max(stiffest, boundary.stable);
  Figure figure;
  figure.title =
      fmt::format("Stable gains of the {} axis: {:.3g} kg, {:.3g} N s/m, delay {:.3g} ms, {:g} Hz", "xyz"[map.axis],
                  map.loop.mass, map.loop.viscous, 1e3 * (map.loop.delay + map.loop.lag), map.loop.rate_hz);
  figure.caption = fmt::format(
      "Below its line the loop is passive with any passive hand, stable by analysis, stable in simulation without "
      "friction and encoder resolution, or calm in simulation with them. Present gains {:g} N/m and {:g} N s/m: "
      "modulus margin "
      "{:.2f}, gain {:.3g}, phase {:.0f} deg, delay {:.2f} ms. Velocity: {}.{}",
      map.present.kp, map.present.kd, map.margins.modulus, map.margins.gain_up, map.margins.phase * 180 / pi,
      1e3 * map.margins.delay, map.loop.velocity,
      map.loop.observer ? fmt::format(" With a disturbance observer of {:g} Hz.", map.loop.observer->bandwidth_hz)
                        : "");
  figure.rows = {{panel_of(map, "All", map.kd.back(), 1.1 * stiffest)}};
  const double kd_near = 3 * map.present.kd, kp_near = 3 * map.present.kp;
  if (kd_near > 0 && kp_near > 0 && kd_near < map.kd.back() && kp_near < stiffest)
    figure.rows[0].push_back(panel_of(map, "Around the present gains", kd_near, kp_near));
  figure.height = 560;
  return figure;
}

}  // namespace haptrace
