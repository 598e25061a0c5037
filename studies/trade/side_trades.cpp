#include "studies/trade/side_trades.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/stopwatch.h"
#include "control/path/arc_path.h"
#include "control/path/place_tracker.h"
#include "devices/sim/noise.h"
#include "devices/sim/sim_device.h"
#include "player/device_path.h"
#include "studies/trade/instruction_count.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kFinestSpacing = 5e-5;  // [m]
constexpr std::array kSpacings{1e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 5e-3};
constexpr double kWander = 2e-3;       // rms per axis [m]
constexpr double kTraineeRate = 1000;  // [Hz]
constexpr std::array kSteps{1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5};
constexpr double kFinestStep = 2e-6;  // [s]
constexpr std::array kIntegrators{"euler", "semi-implicit", "verlet", "rk4", "implicit", "exact"};

ArcPath arc_path_of(const Path& path, double spacing) {
  ArcPath::Builder builder(spacing);
  for (std::size_t i = 0; i < path.size(); ++i)
    builder.add(path.time[i], path.position[i], path.force.empty() ? Vec3::Zero() : path.force[i]);
  return builder.finish(5e-3);
}

/// Returns a trainee's position at every tick: along the path at varying speed, offset by noise below 2 Hz.
std::vector<Vec3> wandering(const Path& path, std::uint64_t seed) {
  Gaussian random(seed, 3);
  ColouredNoise wander = ColouredNoise::low_pass(kWander, 2, kTraineeRate);
  Path timed = path;
  timed.velocity.clear();
  const Trajectory trajectory(timed, Interpolation::linear);
  Trajectory::Cursor cursor;
  std::vector<Vec3> positions;
  for (double t = 0, elapsed = 0; t < trajectory.duration(); elapsed += 1 / kTraineeRate) {
    positions.push_back(trajectory.sample(t, cursor).position + wander.next(random));
    t += std::pow(3, std::sin(2 * elapsed)) / kTraineeRate;
  }
  return positions;
}

/// Stores the true trajectory of a session's tool.
class TrueWay final : public SampleSink {
 public:
  TrueWay(const SimDevice& device, std::size_t expected) : device_(device) { way_.reserve(expected); }
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    if (sample.phase == Phase::run && way_.size() < way_.capacity()) way_.push_back(device_.true_position());
  }
  [[nodiscard]] const std::vector<Vec3>& way() const noexcept { return way_; }

 private:
  const SimDevice& device_;
  std::vector<Vec3> way_;
};

double rms_between(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double squares = 0;
  const std::size_t count = std::min(a.size(), b.size());
  for (std::size_t i = 0; i < count; ++i) squares += (a[i] - b[i]).squaredNorm();
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : kNaN;
}

}  // namespace

const std::vector<StorageLevel>& storage_levels() {
  static const std::vector<StorageLevel> levels = [] {
    const Precision fine = parse_precision("1um,1mN,1mm/s"), coarse = parse_precision("10um,10mN,10mm/s");
    return std::vector<StorageLevel>{
        {"plain", {}},
        {"--precision 1um,1mN,1mm/s", {.precision = fine}},
        {"--compress 1", {.deflate = 1}},
        {"--compress 6", {.deflate = 6}},
        {"--precision 1um,1mN,1mm/s --compress 6", {.deflate = 6, .precision = fine}},
        {"--precision 10um,10mN,10mm/s --compress 6", {.deflate = 6, .precision = coarse}}};
  }();
  return levels;
}

SideTrade trade_of_storage(const Workbench& bench, const Configuration& configuration, const StopRequest& stop) {
  SideTrade trade{.knob = std::string(kStorageKnob),
                  .what = "storage of the recording",
                  .columns = {{"bytes_per_hour", "MB/h", 1e6, 0},
                              {"position_error_m", "mm", 1e-3, 5},
                              {"force_error_n", "N", 1, 5},
                              {"row_cpu_s", "us/sample", 1e-6, 2}},
                  .levels = {}};
  for (const StorageLevel& level : storage_levels()) {
    if (stop.count() > 0) break;
    SideTrade::Level row{.level = level.name, .is_default = level.name == "plain", .values = {}, .refused = {}};
    try {
      const Workbench::Stored stored = bench.record(configuration, level.storage);
      row.values = {stored.bytes_per_hour, stored.position_error, stored.force_error, stored.row_time};
    } catch (const Error& error) {
      row.refused = error.what();
    }
    trade.levels.push_back(std::move(row));
  }
  return trade;
}

namespace {

/// A trainee's walk near an expert's path, and the places on the path that the finest spacing of knots finds.
class Projection {
 public:
  Projection(std::vector<Vec3> trainee, const ArcPath& finest) : trainee_(std::move(trainee)) {
    PlaceTracker exact(finest, {.allow_back = true});
    exact.start();
    for (std::size_t i = 0; i < trainee_.size(); ++i)
      places_.push_back(exact.update(trainee_[i], step_before(i)).place);
  }

  struct Errors {
    double rms = 0, peak = 0;  ///< of the place [m]
    double force = 0;          ///< rms of the expert's force [N]
  };
  /// Returns the distances from the exact places.
  [[nodiscard]] Errors errors(PlaceTracker& tracker) const {
    tracker.start();
    double squares = 0, peak = 0, forces = 0;
    for (std::size_t i = 0; i < trainee_.size(); ++i) {
      const auto& foot = tracker.update(trainee_[i], step_before(i));
      const double off = (foot.place.position - places_[i].position).squaredNorm();
      squares += off;
      peak = std::max(peak, off);
      forces += (foot.place.force - places_[i].force).squaredNorm();
    }
    const auto n = static_cast<double>(trainee_.size());
    return {std::sqrt(squares / n), std::sqrt(peak), std::sqrt(forces / n)};
  }

  /// Returns the time of an update [s].
  [[nodiscard]] double time(PlaceTracker& tracker) const {
    tracker.start();
    const Stopwatch watch;
    walk(tracker, 0, trainee_.size());
    const double elapsed = watch.seconds();
    return elapsed / static_cast<double>(trainee_.size());
  }

  /// Returns the instructions of an update; NaN if they cannot be counted.
  [[nodiscard]] double instructions(PlaceTracker& tracker) const {
    constexpr std::size_t kCounted = 25;
    tracker.start();
    if (trainee_.size() <= 3 * kCounted) return kNaN;
    const std::vector<std::uint64_t> counted = count_instructions([&](const std::function<void()>& mark) {
      walk(tracker, 0, kCounted);
      mark();
      walk(tracker, kCounted, 2 * kCounted);
      mark();
    });
    return counted.empty() ? kNaN : static_cast<double>(counted.front()) / kCounted;
  }

 private:
  static double step_before(std::size_t i) { return i > 0 ? 1 / kTraineeRate : 0; }

  void walk(PlaceTracker& tracker, std::size_t from, std::size_t to) const {
    for (std::size_t i = from; i < to; ++i) (void)tracker.update(trainee_[i], 1 / kTraineeRate);
  }

  std::vector<Vec3> trainee_;
  std::vector<ArcPath::Place> places_;
};

}  // namespace

SideTrade trade_of_projection(const Workbench& bench, bool instructions, const StopRequest& stop) {
  SideTrade trade{.knob = "spacing",
                  .what = "spacing of the path's knots, along which guidance locates the trainee",
                  .columns = {{"place_error_m", "rms mm", 1e-3, 4},
                              {"peak_place_error_m", "peak mm", 1e-3, 3},
                              {"force_error_n", "force N", 1, 4},
                              {"update_s", "ns", 1e-9, 0},
                              {"instructions", "instr.", 1, 0}},
                  .levels = {}};
  const DevicePath played = path_for(bench.device(), bench.place().path, bench.place().play.fit);
  const PathSource& source = *played.source;
  const Path path = source.read(0, source.facts().rows);
  const ArcPath finest = arc_path_of(path, kFinestSpacing);
  if (finest.length() <= 0) return trade;
  const Projection projection(wandering(path, bench.place().seed), finest);
  const double usual = ArcPath::spacing_for(path.bounds().size().norm());
  for (const double spacing : kSpacings) {
    if (stop.count() > 0) break;
    const ArcPath arc = arc_path_of(path, spacing);
    PlaceTracker tracker(arc, {.allow_back = true});
    const Projection::Errors errors = projection.errors(tracker);
    const double time = projection.time(tracker);
    trade.levels.push_back({.level = fmt::format("{:g} mm", 1e3 * spacing),
                            .is_default = std::abs(spacing - usual) < 1e-9,
                            .values = {errors.rms, errors.peak, source.facts().force ? errors.force : kNaN, time,
                                       instructions ? projection.instructions(tracker) : kNaN},
                            .refused = {}});
  }
  return trade;
}

SideTrade trade_of_simulation(
    const Workbench& bench, const Configuration& configuration,
    const std::function<std::unique_ptr<Device>(const std::vector<std::pair<std::string, std::string>>&)>& open,
    const StopRequest& stop) {
  SideTrade trade{.knob = "simulation",
                  .what = "integrator and longest step of the simulated device",
                  .columns = {{"way_difference_m", "path mm", 1e-3, 4},
                              {"error_change_m", "error mm", 1e-3, 4},
                              {"ripple_change_n", "ripple N", 1, 4},
                              {"millisecond_s", "us/ms", 1e-6, 2}},
                  .levels = {}};
  struct Run {
    std::vector<Vec3> way;
    double error = 0, ripple = 0;
    double millisecond = kNaN;
  };
  // Learning is off, because it would also learn the integration errors.
  Configuration plain = configuration;
  plain.learn = 0;
  const auto run = [&](const std::string& integrator, double step) {
    const auto device = open({{"integrator", integrator}, {"step", fmt::format("{:g}", step)}});
    const auto* sim = dynamic_cast<const SimDevice*>(device.get());
    if (sim == nullptr) throw input_error("only a simulated device has an integrator");
    PlayOptions options = bench.options_for(plain);
    TrueWay way(*sim, static_cast<std::size_t>((bench.duration() / plain.speed + 1) * plain.rate_hz));
    options.sinks.push_back(&way);
    const Stopwatch watch;
    const PlayResult result =
        play(*device, plan_playback(device->info(), bench.place().path, options), options, StopRequest{});
    if (result.session.servo.cause != StopCause::finished) throw input_error(result.session.servo.detail);
    return Run{way.way(), result.last.rms_error, result.last.force_ripple,
               1e-3 * watch.seconds() / std::max(result.session.servo.duration, 1e-9)};
  };
  if (dynamic_cast<const SimDevice*>(open({}).get()) == nullptr) return trade;
  const Run finest = run("exact", kFinestStep);
  for (const char* integrator : kIntegrators) {
    for (const double step : kSteps) {
      if (stop.count() > 0) return trade;
      SideTrade::Level row{.level = fmt::format("{} {:g} us", integrator, 1e6 * step),
                           .is_default = std::string_view(integrator) == "semi-implicit" && step == 5e-5,
                           .values = {},
                           .refused = {}};
      try {
        const Run tried = run(integrator, step);
        row.values = {rms_between(tried.way, finest.way), tried.error - finest.error, tried.ripple - finest.ripple,
                      tried.millisecond};
      } catch (const Error& error) {
        row.refused = error.what();
      }
      trade.levels.push_back(std::move(row));
    }
  }
  return trade;
}

nlohmann::json to_json(const SideTrade& trade) {
  nlohmann::json levels = nlohmann::json::array();
  for (const SideTrade::Level& level : trade.levels) {
    nlohmann::json row{{"level", level.level}, {"default", level.is_default}};
    if (!level.refused.empty()) row["refused"] = level.refused;
    for (std::size_t i = 0; i < level.values.size(); ++i) row[trade.columns[i].key] = json_of_number(level.values[i]);
    levels.push_back(std::move(row));
  }
  return {{"knob", trade.knob}, {"what", trade.what}, {"levels", levels}};
}

std::string text_of(const SideTrade& trade) {
  if (trade.levels.empty()) return "";
  std::string text = fmt::format("\n{}\n   {:<42}", trade.what, trade.knob);
  for (const SideTrade::Column& column : trade.columns) text += fmt::format(" {:>10}", column.head);
  text += "\n";
  for (const SideTrade::Level& level : trade.levels) {
    text += fmt::format("  {}{:<42}", level.is_default ? "*" : " ", level.level);
    if (!level.refused.empty()) text += " refused: " + level.refused;
    for (std::size_t i = 0; i < level.values.size(); ++i)
      text += std::isfinite(level.values[i])
                  ? fmt::format(" {:>10.{}f}", level.values[i] / trade.columns[i].scale, trade.columns[i].digits)
                  : fmt::format(" {:>10}", "-");
    text += "\n";
  }
  return text;
}

}  // namespace haptrace
