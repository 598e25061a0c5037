#include "studies/staircase.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/parallel.h"
#include "control/design/loop_analysis.h"
#include "control/passivity_layer.h"
#include "control/velocity_estimator.h"
#include "devices/sim/sim_device.h"
#include "scene/scene_controller.h"
#include "scene/scene_file.h"
#include "scene/shape/plane.h"
#include "scene/surface/elastic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi;
using json_value = nlohmann::json;

constexpr double kSwingWindow = 0.25;  // window of a swing measurement [s]
constexpr std::size_t kLast = 4;       // windows in which the swing of a moving device must shrink
constexpr double kDecays = 0.7;        // ... to this share, for the device to count as calm
constexpr double kThrownBy = 100;      // energy at which the tap ends, relative to that of the fall
constexpr double kLookout = 1;         // distance from the origin within which a scene has a surface [m]
constexpr const char* kVelocity = "lowpass:100";

// --- Scene and loop -------------------------------------------------------------------------------------------------

/// Surface of a scene, as met from outside.
struct MetSurface {
  Vec3 place = Vec3::Zero(), normal = Vec3::UnitZ();
};

std::shared_ptr<Scene> pressed_scene(const StaircaseOptions& options, double stiffness) {
  if (!options.scene.is_null()) return read_scene(options.scene, options.scene_name);
  std::vector<std::unique_ptr<Object>> objects;
  objects.push_back(make_fixed_object("wall", "plane", std::make_unique<Plane>(PlaneSpec{}),
                                      std::make_unique<ElasticSurface>(ElasticSpec{.stiffness = stiffness})));
  return std::make_shared<Scene>(std::move(objects));
}

/// Returns the nearest surface that an object of the scene knows from the origin.
MetSurface surface_of(Scene& scene, const std::string& name) {
  scene.prepare({.ahead = kLookout});
  const Contact* nearest = nullptr;
  const SceneAnswer answer = scene.answer({});
  for (const Contact& contact : answer.contacts)
    if (!contact.normal.isZero() && (nearest == nullptr || contact.depth > nearest->depth)) nearest = &contact;
  if (nearest == nullptr)
    throw input_error(fmt::format(
        "{}: no object has a surface that is known at the origin; give a scene with a wall or a sphere", name));
  return {nearest->depth * nearest->normal, nearest->normal};
}

/// A scene with its controller as in a session, and a second instance that reports the energy stored in its springs.
class Touched {
 public:
  Touched(const StaircaseOptions& options, double stiffness, double rate_hz,
          const std::optional<PassivityLayer::Options>& layer)
      : judge_(pressed_scene(options, stiffness)),
        surface_(surface_of(*judge_, options.scene_name)),
        controller_(make_scene_controller(pressed_scene(options, stiffness), rate_hz, std::nullopt, layer)) {}

  [[nodiscard]] const MetSurface& surface() const { return surface_; }
  [[nodiscard]] Controller& controller() { return *controller_; }

  [[nodiscard]] double stored(const Vec3& position) { return judge_->answer({.position = position}).stored; }

  /// Returns the stiffness along the normal at `depth` [N/m].
  [[nodiscard]] double stiffness(double depth) {
    double sum = 0;
    for (const Contact& contact : judge_->answer({.position = surface_.place - depth * surface_.normal}).contacts)
      if (contact.touched()) sum += contact.stiffness;
    return sum;
  }

 private:
  std::shared_ptr<Scene> judge_;
  MetSurface surface_;
  std::unique_ptr<SceneController> controller_;
};

/// Runs the servo loop of a session in virtual time, without its fades, limits and guard.
void run_loop(Device& device, Controller& controller, SampleSink& sink, double rate_hz, const StopRequest& end) {
  const auto estimator = make_velocity_estimator(kVelocity, rate_hz, device.info().position_resolution);
  ServoOptions options{.rate_hz = rate_hz, .virtual_time = true, .realtime = false, .watch_vibration = false};
  options.limits.soft_start = options.limits.release = 0;
  std::array<SampleSink*, 1> sinks{&sink};
  (void)ServoLoop(device, controller, *estimator, sinks, options).run(end);
}

/// Ends a session at this tick.
void end_now(StopRequest& end) {
  while (end.count() < 2) end.raise();
}

// --- Prescribed press -----------------------------------------------------------------------------------------------

/// A tool that moves into a surface and out again, regardless of the force on it.
class PressedTool final : public Device, public SampleSink {
 public:
  PressedTool(const StaircaseOptions& options, Touched& touched, double rate_hz, double phase, const StopRequest& stop)
      : depth_(options.depth),
        duration_(options.duration),
        begin_((3 + phase) / rate_hz),
        end_time_(begin_ + duration_ + 8 / rate_hz),
        touched_(touched),
        end_(&stop) {
    info_.name = info_.model = "a prescribed press";
    info_.virtual_time = true;
    info_.force_axes = {true, true, true};
    info_.nominal_rate = rate_hz;
  }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  void close() noexcept override {}
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const double before = depth_at(time_), force = wrench.force.dot(touched_.surface().normal);
    if (dt > 0 && keep_ != nullptr) {
      keep_->depth.insert(keep_->depth.end(), {before, depth_at(time_ + dt)});
      keep_->force.insert(keep_->force.end(), {force, force});
    }
    time_ += dt;
    const double depth = depth_at(time_);
    given_ += force * (before - depth);
    state = DeviceState{};
    state.position = touched_.surface().place - depth * touched_.surface().normal;
    created_ = given_ + touched_.stored(state.position);
    most_ = std::max(most_, created_);
    return Status::ok;
  }
  using SampleSink::push;
  void push(const Sample&) noexcept override {
    if (time_ >= end_time_) end_now(end_);
  }

  /// Stores the stairs of the next run in `stairs`, which must outlive it.
  void keep(Stairs& stairs) {
    keep_ = &stairs;
    const auto ticks = static_cast<std::size_t>(std::ceil(end_time_ * info_.nominal_rate)) + 8;
    for (std::vector<double>* column : {&stairs.depth, &stairs.force}) column->reserve(2 * ticks);
  }
  void run(double rate_hz) { run_loop(*this, touched_.controller(), *this, rate_hz, end_); }

  [[nodiscard]] double created() const { return created_; }  ///< at the end [J]
  [[nodiscard]] double most() const { return most_; }        ///< at the worst tick [J]

 private:
  /// Returns the depth: a half sine that starts and ends at constant speed [m].
  [[nodiscard]] double depth_at(double time) const {
    const double t = time - begin_, speed = pi * depth_ / duration_;
    if (t < 0) return speed * t;
    if (t > duration_) return speed * (duration_ - t);
    return depth_ * std::sin(pi * t / duration_);
  }

  double depth_, duration_, begin_, end_time_;
  Touched& touched_;
  StopRequest end_;
  DeviceInfo info_;
  Stairs* keep_ = nullptr;
  double time_ = 0, given_ = 0, created_ = 0, most_ = 0;
};

// --- Tap ------------------------------------------------------------------------------------------------------------

/// A simulated device that a constant force presses towards a surface, starting `height` above it.
class TappingDevice final : public Device, public SampleSink {
 public:
  TappingDevice(const StaircaseOptions& options, const SimSpec& spec, Touched& touched, double rate_hz, double push,
                const StopRequest& stop)
      : device_(spec, {.seed = options.seed, .intent = {}, .longest_step = step(rate_hz)}),
        touched_(touched),
        offset_(touched.surface().place + options.height * touched.surface().normal - device_.true_position()),
        push_(-push * touched.surface().normal),
        calm_(std::max(std::min(0.01 * options.height, 0.1 * push / touched.stiffness(1e-6)),
                       2 * spec.position_resolution)),
        ruined_(kThrownBy * push * options.height),
        small_(0.2 * options.height),
        windows_(static_cast<int>(std::ceil(options.watched / kSwingWindow))),
        ticks_(std::llround(kSwingWindow * rate_hz)),
        end_(&stop) {}

  /// Returns the integration step: a twentieth of a tick, at most the default [s].
  static double step(double rate_hz) { return std::min(SimOptions{}.longest_step, 0.05 / rate_hz); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  void close() noexcept override { device_.close(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    const Status status = device_.exchange({wrench.force + push_, wrench.torque}, dt, state);
    state.position += offset_;
    return status;
  }
  using SampleSink::push;
  void push(const Sample&) noexcept override {
    const Vec3 moved = device_.true_position() + offset_;
    const double height = (moved - touched_.surface().place).dot(touched_.surface().normal);
    const double created = device_.plant().motor_work() - push_.dot(moved - offset_) + touched_.stored(moved);
    created_ = std::max(created_, created);
    low_ = std::min(low_, height);
    high_ = std::max(high_, height);
    if (!(std::abs(created) < ruined_)) return end_now(end_);
    if (++count_ % ticks_ == 0) end_window();
  }

  void run(double rate_hz) { run_loop(*this, touched_.controller(), *this, rate_hz, end_); }

  [[nodiscard]] bool calm() const { return came_to_rest_; }
  [[nodiscard]] double created() const { return created_; }  ///< [J]

 private:
  void end_window() {
    const double swing = high_ - low_;
    std::rotate(swings_.begin(), swings_.begin() + 1, swings_.end());
    swings_.back() = swing;
    const bool over = --windows_ <= 0;
    came_to_rest_ = swing <= calm_ || (over && swing <= small_ && dies_away());
    if (came_to_rest_ || over) end_now(end_);
    low_ = std::numeric_limits<double>::infinity();
    high_ = -low_;
  }

  [[nodiscard]] bool dies_away() const {
    return std::is_sorted(swings_.rbegin(), swings_.rend()) && swings_.back() <= kDecays * swings_.front();
  }

  SimDevice device_;
  Touched& touched_;
  Vec3 offset_, push_;
  double calm_, ruined_, small_;  ///< [m], [J], [m]
  int windows_;
  std::int64_t ticks_, count_ = 0;
  StopRequest end_;
  std::array<double, kLast> swings_{};  ///< swings of the last windows, newest last [m]
  double created_ = 0;
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
  bool came_to_rest_ = false;
};

// --- The study ------------------------------------------------------------------------------------------------------

SimSpec default_tapped_device() {
  SimSpec spec;
  spec.model = "a simulated device of 0.2 kg";
  spec.max_force = spec.max_continuous_force = 1000;
  spec.mass.setConstant(0.2);
  spec.viscous.setConstant(1);
  spec.coulomb.setConstant(0.3);
  return spec;
}

/// Returns `spec` without hand, gravity and cogging, in an unbounded workspace.
SimSpec freed(SimSpec spec) {
  spec.hand.reset();
  spec.gravity_bias.setZero();
  spec.gravity_gradient.setZero();
  spec.cogging.setZero();
  spec.workspace = {Vec3::Constant(-1e6), Vec3::Constant(1e6)};
  return spec;
}

SimSpec without_friction(SimSpec spec) {
  spec.coulomb.setZero();
  spec.presliding_stiffness.setZero();
  spec.presliding_damping = 0;
  return spec;
}

double motor_lag(const SimSpec& spec) {
  return spec.actuator_bandwidth_hz > 0 ? 1 / (2 * pi * spec.actuator_bandwidth_hz) : 0;
}

/// Returns the loop with the smallest mass and damping of the axes, the least stable one.
LoopModel loop_of_tapped(const SimSpec& spec, double rate_hz) {
  return {.mass = spec.mass.minCoeff(),
          .viscous = spec.viscous.minCoeff(),
          .delay = spec.delay,
          .lag = motor_lag(spec),
          .rate_hz = rate_hz,
          .velocity = "difference",
          .resolution = spec.position_resolution};
}

double pushing(const StaircaseOptions& options, const SimSpec& spec) {
  return std::max(options.push, 3 * spec.coulomb.maxCoeff() * std::max(spec.static_ratio, 1.0));
}

void check_staircase(const StaircaseOptions& options) {
  if (options.rates.empty() || options.pressed.empty())
    throw input_error("the staircase needs at least one rate and one stiffness");
  for (const double rate : options.rates) check_range("the rate", rate, 20, kHighestRate, "Hz");
  for (const auto* list : {&options.pressed, &options.tapped})
    for (const double k : *list) check_range("the stiffness of the wall", k, 1, 1e7, "N/m");
  check_range("the depth of the press", options.depth, 1e-6, 0.1, "m");
  check_range("the duration of the press", options.duration, 0.1, 10, "s");
  check_range("the number of phases", options.phases, 1, 1000);
  check_range("the force that presses the device", options.push, 0.01, 100, "N");
  check_range("the height of the fall", options.height, 1e-4, 0.1, "m");
  check_range("the time until the verdict", options.watched, kSwingWindow * static_cast<double>(kLast), 100, "s");
}

/// All measurements as jobs that write to separate places: stairs first, then presses, then taps.
class StaircaseJobs {
 public:
  StaircaseJobs(StaircaseReport& report, const StopRequest& stop)
      : report_(report), spec_(freed(*report.options.device)), stop_(stop) {
    const StaircaseOptions& options = report.options;
    const Vec3 normal = surface_of(*pressed_scene(options, options.pressed.front()), options.scene_name).normal;
    for (int axis = 0; axis < 3; ++axis)
      if (std::abs(normal[axis]) > 1e-9 && !spec_.axes[static_cast<std::size_t>(axis)])
        throw input_error(
            fmt::format("{}: has no motor along {}, the axis of the wall; give a scene whose wall needs no motor along "
                        "it (--scene)",
                        spec_.model, "xyz"[axis]));
    for (const double rate : options.rates) {
      const LoopModel loop = loop_of_tapped(spec_, rate);
      layers_.push_back(passivity_layer_for(loop));
      const LoopAnalysis analysis(loop);
      for (const double k : options.pressed) report_.presses.push_back({.rate_hz = rate, .stiffness = k});
      for (const double k : options.tapped)
        for (const bool friction : {false, true})
          for (const bool supervised : {false, true})
            report_.taps.push_back({.rate_hz = rate,
                                    .stiffness = k,
                                    .friction = friction,
                                    .supervised = supervised,
                                    .asked = analysis.passive_damping(k, 0)});
    }
    report_.max_damping = layers_.front().max_damping;
    std::vector<double> slow{options.rates.front()}, soft{options.pressed.front()};
    if (options.rates.size() > 2) slow.push_back(options.rates[2]);
    if (options.pressed.size() > 1) soft.push_back(options.pressed.back());
    for (const double rate : slow)
      for (const double k : soft) report_.stairs.push_back({.rate_hz = rate, .stiffness = k});
  }

  [[nodiscard]] std::size_t count() const {
    return report_.stairs.size() + report_.presses.size() + report_.taps.size();
  }

  void work(std::size_t job) {
    if (job < report_.stairs.size()) return keep_stairs(report_.stairs[job]);
    job -= report_.stairs.size();
    if (job < report_.presses.size()) return press(report_.presses[job], job / report_.options.pressed.size());
    job -= report_.presses.size();
    tap(report_.taps[job], job / (4 * report_.options.tapped.size()));
  }

 private:
  void keep_stairs(Stairs& stairs) {
    Touched touched(report_.options, stairs.stiffness, stairs.rate_hz, {});
    PressedTool tool(report_.options, touched, stairs.rate_hz, 0.5, stop_);
    tool.keep(stairs);
    tool.run(stairs.rate_hz);
  }

  void press(StaircasePress& press, std::size_t rate) {
    const StaircaseOptions& options = report_.options;
    const double period = 1 / press.rate_hz, speed = pi * options.depth / options.duration;
    press.expected = press.stiffness * period / 2 * (speed * speed * options.duration / 2);
    press.slack = press.stiffness * std::pow(speed * period, 2) / 8 +
                  press.expected * std::pow(pi * period / options.duration, 2) / 12;
    press.least = std::numeric_limits<double>::infinity();
    press.most = -press.least;
    for (int i = 0; i < options.phases; ++i) {
      const double phase = static_cast<double>(i) / options.phases;
      Touched bare(options, press.stiffness, press.rate_hz, {});
      PressedTool tool(options, bare, press.rate_hz, phase, stop_);
      tool.run(press.rate_hz);
      press.mean += tool.created() / options.phases;
      press.least = std::min(press.least, tool.created());
      press.most = std::max(press.most, tool.created());
      Touched supervised(options, press.stiffness, press.rate_hz, prescribed(layers_[rate]));
      PressedTool kept(options, supervised, press.rate_hz, phase, stop_);
      kept.run(press.rate_hz);
      press.supervised = std::max(press.supervised, kept.most());
    }
  }

  /// Returns the layer without delay, because forces act on a prescribed tool at once.
  static PassivityLayer::Options prescribed(PassivityLayer::Options layer) {
    layer.delay = 0;
    return layer;
  }

  void tap(StaircaseTap& tap, std::size_t rate) {
    const StaircaseOptions& options = report_.options;
    SimSpec spec = tap.friction ? spec_ : without_friction(spec_);
    // Semi-implicit Euler computes positions half a step early, which would shorten the delay by as much. The work of
    // the motors includes the delay, so the passivity layer must include it too.
    const double half_step = TappingDevice::step(tap.rate_hz) / 2;
    spec.delay += half_step;
    std::optional<PassivityLayer::Options> layer;
    if (tap.supervised) {
      layer = layers_[rate];
      layer->delay += half_step;
    }
    Touched touched(options, tap.stiffness, tap.rate_hz, layer);
    TappingDevice device(options, spec, touched, tap.rate_hz, pushing(options, spec_), stop_);
    device.run(tap.rate_hz);
    tap.calm = device.calm();
    tap.created = device.created();
  }

  StaircaseReport& report_;
  SimSpec spec_;
  const StopRequest& stop_;
  std::vector<PassivityLayer::Options> layers_;  ///< one for each rate
};

}  // namespace

double StaircaseReport::calm_up_to(double rate_hz, bool friction, bool supervised) const {
  double up_to = 0;
  for (const StaircaseTap& tap : taps) {
    if (tap.rate_hz != rate_hz || tap.friction != friction || tap.supervised != supervised) continue;
    if (!tap.calm) break;
    up_to = tap.stiffness;
  }
  return up_to;
}

double StaircaseReport::passive_up_to(double rate_hz) const {
  for (const StaircaseTap& tap : taps)
    if (tap.rate_hz == rate_hz) return viscous / tap.asked * tap.stiffness;
  return kNaN;
}

StaircaseReport staircase(const StaircaseOptions& options, const StopRequest& stop,
                          const std::function<void(double)>& progress) {
  StaircaseReport report{.options = options};
  StaircaseOptions& used = report.options;
  if (!used.device) used.device = default_tapped_device();
  if (!used.scene.is_null()) {
    Touched touched(used, 0, 1000, {});
    used.pressed = used.tapped = {touched.stiffness(used.depth)};
  }
  if (used.tapped.empty())
    for (int i = 0; i <= 12; ++i) used.tapped.push_back(100 * std::pow(10, 0.25 * i));
  check_staircase(used);
  const LoopModel loop = loop_of_tapped(*used.device, used.rates.front());
  report.mass = loop.mass;
  report.viscous = loop.viscous;
  report.coulomb = used.device->coulomb.minCoeff();
  report.delay = loop.delay + loop.lag;

  StaircaseJobs jobs(report, stop);
  report.complete = run_parallel(
      jobs.count(), used.threads, stop, [&](std::size_t job) { jobs.work(job); },
      [&](std::size_t done) {
        if (progress) progress(static_cast<double>(done) / static_cast<double>(jobs.count()));
      });
  return report;
}

json_value to_json(const StaircaseReport& report) {
  const StaircaseOptions& options = report.options;
  json_value presses = json_value::array(), taps = json_value::array();
  for (const StaircasePress& press : report.presses)
    presses.push_back({{"rate_hz", press.rate_hz},
                       {"stiffness", press.stiffness},
                       {"created_j", {{"mean", press.mean}, {"least", press.least}, {"most", press.most}}},
                       {"expected_j", press.expected},
                       {"slack_j", press.slack},
                       {"with_passivity_layer_j", press.supervised}});
  for (const StaircaseTap& tap : report.taps)
    taps.push_back({{"rate_hz", tap.rate_hz},
                    {"stiffness", tap.stiffness},
                    {"friction", tap.friction},
                    {"passivity_layer", tap.supervised},
                    {"calm", tap.calm},
                    {"created_j", json_of_number(tap.created)},
                    {"asked_damping", tap.asked}});
  return {
      {"press",
       {{"depth_m", options.depth}, {"duration_s", options.duration}, {"phases", options.phases}, {"runs", presses}}},
      {"tap",
       {{"device",
         {{"model", options.device->model},
          {"mass", report.mass},
          {"viscous", report.viscous},
          {"coulomb", report.coulomb},
          {"delay_s", report.delay}}},
        {"push_n", pushing(options, *options.device)},
        {"height_m", options.height},
        {"watched_s", options.watched},
        {"runs", taps}}}};
}

std::string text_of(const StaircaseReport& report) {
  const StaircaseOptions& options = report.options;
  std::string text = fmt::format(
      "the staircase: a press of {:g} mm in {:g} s, and a tap by {:g} kg with {:g} N s/m and {:g} N of friction\n"
      "  {:>8}  {:>10}  {:>12} {:>12} {:>12}   {:>10} {:>10} {:>10} {:>10}\n"
      "  {:>8}  {:>10}  {:>12} {:>12} {:>12}   {:>10} {:>10} {:>10} {:>10}\n",
      1e3 * options.depth, options.duration, report.mass, report.viscous, report.coulomb, "rate", "stiffness",
      "created", "closed form", "layer on", "passive", "calm", "friction", "layer on", "Hz", "N/m", "mJ", "mJ", "mJ",
      "N/m", "N/m", "N/m", "N/m");
  for (const StaircasePress& press : report.presses) {
    text += fmt::format("  {:8.0f}  {:10.0f}  {:12.4g} {:12.4g} {:12.4g}", press.rate_hz, press.stiffness,
                        1e3 * press.mean, 1e3 * press.expected, 1e3 * press.supervised);
    if (press.stiffness == options.pressed.back())
      text += fmt::format("   {:10.3g} {:10.3g} {:10.3g} {:10.3g}", report.passive_up_to(press.rate_hz),
                          report.calm_up_to(press.rate_hz, false, false), report.calm_up_to(press.rate_hz, true, false),
                          report.calm_up_to(press.rate_hz, false, true));
    text += "\n";
  }
  text +=
      "  passive: largest stiffness that needs no more damping than the device has; calm: largest tested stiffness at "
      "which the device came to rest\n";
  return text;
}

namespace {

Panel panel_of_stairs(const StaircaseReport& report, double stiffness, double highest) {
  Panel panel{.title = fmt::format("{:g} N/m", stiffness), .x_label = "depth [mm]", .y_label = "force [N]"};
  int color = 1;
  double deepest = 0;
  for (const Stairs& stairs : report.stairs) {
    if (stairs.stiffness != stiffness) continue;
    Series series{
        .label = fmt::format("{:g} Hz", stairs.rate_hz), .x = {}, .y = stairs.force, .color = color, .width = 1.1};
    for (const double depth : stairs.depth) series.x.push_back(1e3 * depth);
    for (const double depth : stairs.depth) deepest = std::max(deepest, depth);
    panel.series.push_back(std::move(series));
    color = 0;
  }
  panel.series.push_back({.label = "in continuous time",
                          .x = {-1, 0, 1e3 * deepest},
                          .y = {0, 0, stiffness * deepest},
                          .color = 7,
                          .dashed = true,
                          .width = 0.9});
  panel.x_range = {-1, 1.05e3 * deepest};
  panel.y_range = {-0.03 * highest, 1.05 * highest};
  return panel;
}

std::pair<double, double> range_of_rates(const StaircaseReport& report) {
  const auto [least, most] = std::minmax_element(report.options.rates.begin(), report.options.rates.end());
  return {0.8 * *least, 1.25 * *most};
}

Panel panel_of_presses(const StaircaseReport& report) {
  Panel panel{.title = "Energy created by a press",
              .x_label = "rate [Hz]",
              .y_label = "energy [mJ]",
              .log_x = true,
              .log_y = true};
  constexpr std::array kColors{4, 0, 1, 2, 3, 5};
  Series form{.label = "", .x = {}, .y = {}, .color = 7, .width = 0.9};
  std::size_t index = 0;
  for (const double k : report.options.pressed) {
    const int color = kColors[index++ % kColors.size()];
    Series with{.label = "", .x = {}, .y = {}, .color = color, .dashed = true, .width = 1.2};
    Series line = form;
    bool named = false;
    for (const StaircasePress& press : report.presses) {
      if (press.stiffness != k) continue;
      line.x.push_back(press.rate_hz);
      line.y.push_back(1e3 * press.expected);
      with.x.push_back(press.rate_hz);
      with.y.push_back(1e3 * press.supervised);
      panel.series.push_back({.label = named ? "" : fmt::format("{:g} N/m", k),
                              .x = {press.rate_hz},
                              .y = {1e3 * press.mean},
                              .color = color,
                              .width = 2.2});
      named = true;
    }
    if (k == report.options.pressed.back()) {
      line.label = "closed form";
      with.label = "with the passivity layer, at the worst tick";
    }
    panel.series.push_back(std::move(line));
    panel.series.push_back(std::move(with));
  }
  panel.x_range = range_of_rates(report);
  return panel;
}

Panel panel_of_taps(const StaircaseReport& report, bool supervised) {
  Panel panel{.title = supervised ? "With the passivity layer" : "Without the passivity layer",
              .x_label = "rate [Hz]",
              .y_label = "stiffness [N/m]",
              .log_x = true,
              .log_y = true};
  bool calm_named = false, bouncing_named = false;
  for (const StaircaseTap& tap : report.taps) {
    if (tap.friction || tap.supervised != supervised) continue;
    bool& named = tap.calm ? calm_named : bouncing_named;
    panel.series.push_back({.label = named      ? ""
                                     : tap.calm ? "comes to rest"
                                                : "keeps bouncing",
                            .x = {tap.rate_hz},
                            .y = {tap.stiffness},
                            .color = tap.calm ? 0 : 5,
                            .width = 2.4});
    named = true;
  }
  Series bound{.label = "needs the damping of the device", .x = {}, .y = {}, .color = 7, .width = 1.4},
      friction{.label = "with friction, comes to rest up to here",
               .x = {},
               .y = {},
               .color = 2,
               .dashed = true,
               .width = 1.4};
  for (const double rate : report.options.rates) {
    bound.x.push_back(rate);
    bound.y.push_back(report.passive_up_to(rate));
    friction.x.push_back(rate);
    friction.y.push_back(report.calm_up_to(rate, true, supervised));
  }
  panel.series.push_back(std::move(bound));
  panel.series.push_back(std::move(friction));
  panel.x_range = range_of_rates(report);
  const auto& stiffness = report.options.tapped;
  panel.y_range = {0.7 * stiffness.front(), 60 * stiffness.back()};
  return panel;
}

}  // namespace

Figure figure_of(const StaircaseReport& report) {
  const StaircaseOptions& options = report.options;
  double highest = 0;
  for (const Stairs& stairs : report.stairs)
    for (const double force : stairs.force) highest = std::max(highest, force);
  Figure figure;
  figure.title = "The staircase of a sampled wall";
  figure.caption = fmt::format(
      "Above: the sent force, held for one tick, while a hand presses {:g} mm deep and returns within {:g} s. "
      "Middle: energy created by such a press, mean of {} phases of the tick, and pi^2 K T D^2 / (4 t). Below: a mass "
      "of {:g} kg "
      "with {:g} N s/m of damping, pressed by {:g} N, falls {:g} mm onto the wall; {:g} s later the device rests or "
      "bounces.",
      1e3 * options.depth, options.duration, options.phases, report.mass, report.viscous,
      pushing(options, *options.device), 1e3 * options.height, options.watched);
  figure.rows.push_back({panel_of_stairs(report, options.pressed.front(), highest)});
  if (options.pressed.size() > 1) figure.rows[0].push_back(panel_of_stairs(report, options.pressed.back(), highest));
  figure.rows.push_back({panel_of_presses(report)});
  figure.rows.push_back({panel_of_taps(report, false), panel_of_taps(report, true)});
  figure.height = 1180;
  return figure;
}

}  // namespace haptrace
