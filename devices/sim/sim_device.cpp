#include "devices/sim/sim_device.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "control/norm.h"
#include "devices/loop/clock.h"
#include "devices/sim/presets.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kHandRate = 1000;                               // [Hz]
constexpr std::int64_t kHandPeriod = 1'000'000;                  // [ns]
constexpr double kLongestHold = 1e9;                             // a hand that lets go later than this never does [s]
constexpr double kShortestOption = 1e-7, kLongestOption = 1e-2;  // range of the option `step` [s]

double quantised(double value, double quantum) {
  return quantum * std::floor(value / quantum + 0.5);
}

Vec3 quantised(const Vec3& v, double quantum) {
  return {quantised(v.x(), quantum), quantised(v.y(), quantum), quantised(v.z(), quantum)};
}

DeviceInfo describe(const SimSpec& spec, const SimOptions& options) {
  DeviceInfo info;
  info.name = options.name;
  info.serial = options.serial;
  info.backend = "sim";
  info.model = spec.model;
  info.virtual_time = options.steering == nullptr;  // a person's time does not wait
  info.force_axes = spec.axes;
  info.measures_force = spec.force_sensor;
  info.workspace_min = spec.workspace.min;
  info.workspace_max = spec.workspace.max;
  info.position_resolution = spec.position_resolution;
  info.max_force = spec.max_force;
  info.max_continuous_force = spec.max_continuous_force;
  info.nominal_rate = spec.nominal_rate;
  if (spec.wrist) {
    info.torque_axes = {true, true, true};
    info.max_torque = spec.wrist->max_torque;
    info.measures_orientation = true;
  }
  return info;
}

ColouredNoise tremor_of(const SimSpec& spec) {
  constexpr double kLow = 0.75, kHigh = 1.25;  // edges of the band, over its frequency
  const HandSpec hand = spec.hand.value_or(HandSpec{});
  return hand.tremor_hz > 0
             ? ColouredNoise::band_pass(hand.tremor, kLow * hand.tremor_hz, kHigh * hand.tremor_hz, kHandRate)
             : ColouredNoise::band_pass(hand.tremor, 6, 12, kHandRate);
}

ColouredNoise drift_of(const SimSpec& spec) {
  const HandSpec hand = spec.hand.value_or(HandSpec{});
  return hand.drift_hz > 0 ? ColouredNoise::first_order(hand.drift, hand.drift_hz, kHandRate)
                           : ColouredNoise::low_pass(hand.drift, 1, kHandRate);
}

constexpr double kBeyond = 0.02;  // how far outside the workspace a person can pull the hand [m]

bool follows_intent(const SimSpec& spec, const SimOptions& options) {
  return spec.hand && options.intent && options.intent->size() > 0;
}

}  // namespace

SimDevice::SimDevice(const SimSpec& spec, const SimOptions& options)
    : info_(describe(spec, options)),
      lost_from_(options.lost_at),
      lost_until_(options.lost_at + options.lost_for),
      lets_go_(options.lets_go_at < kLongestHold ? std::llround(options.lets_go_at * 1e9) : DelayLine::kNever),
      strongest_(spec.strongest()),
      force_resolution_(spec.force_resolution),
      position_noise_(spec.position_noise),
      force_noise_(spec.force_noise),
      delay_line_(std::llround(spec.delay * 1e9)),
      plant_(spec, follows_intent(spec, options) ? options.intent->sample(0).position : Vec3::Zero(),
             follows_intent(spec, options) || options.steering != nullptr, options.longest_step, options.integrator),
      sensor_noise_(options.seed, 1),
      hand_noise_(options.seed, 2),
      tremor_(tremor_of(spec)),
      drift_(drift_of(spec)),
      steering_(spec.hand ? options.steering : nullptr),
      clock_(options.clock != nullptr ? options.clock : &monotonic_ns) {
  for (int axis = 0; axis < 3; ++axis) force_axes_[axis] = spec.axes[static_cast<std::size_t>(axis)] ? 1 : 0;
  info_.notes = options.notes;
  if (plant_.longest_step() < options.longest_step && options.longest_step != SimOptions{}.longest_step)
    info_.notes.push_back(fmt::format("the simulation uses steps of {:.3g} s at most, not of {:.3g} s: {}",
                                      plant_.longest_step(), options.longest_step,
                                      options.integrator == Integrator::semi_implicit
                                          ? "stiff springs need short steps"
                                          : "longer steps would not be stable"));
  if (follows_intent(spec, options)) {
    intent_ = *options.intent;
    info_.natural_duration = intent_.duration();
  }
  if (spec.wrist) {
    Trajectory::Cursor cursor;
    const Quat start = options.intent_orientation.empty() || !follows_intent(spec, options)
                           ? Quat(Quat::Identity())
                           : options.intent_orientation.sample(0, cursor).orientation;
    wrist_.emplace(TurningHandle{.body = {*spec.wrist, spec.hand ? &*spec.hand : nullptr, start},
                                 .torque = DelayLine(std::llround(spec.delay * 1e9)),
                                 .max_torque = spec.wrist->max_torque,
                                 .resolution = spec.wrist->resolution,
                                 .intent = options.intent_orientation,
                                 .intent_cursor = {},
                                 .intended = start});
  }
  hand_acts_ =
      steering_ != nullptr || intent_.size() > 0 || (spec.hand && (spec.hand->tremor > 0 || spec.hand->drift > 0));
  if (hand_acts_) {
    next_intent_ = plant_.hand_position();
    plan_hand();
  }
}

Device::Status SimDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (closed_) return Status::lost;
  if (steering_ != nullptr) clock_ns_ = clock_();
  const std::int64_t now = time_.ns();
  delay_line_.push(now, cable_is_out() ? Vec3::Zero() : motor_command(wrench));
  input_.command = delay_line_.output();
  if (wrist_) wrist_->torque.push(now, cable_is_out() ? Vec3::Zero() : wrist_command(wrench));
  advance(now, time_.advance(dt));
  if (cable_is_out()) return lost_until_ == SimOptions::kNever ? Status::lost : Status::away;
  measure(state);
  return Status::ok;
}

bool SimDevice::cable_is_out() const noexcept {
  const double now = 1e-9 * static_cast<double>(time_.ns());
  return now >= lost_from_ && now < lost_until_;
}

/// Returns the motor command: saturated and quantised, in actuator axes.
Vec3 SimDevice::motor_command(const Wrench& wrench) const noexcept {
  Vec3 force = sendable(wrench).force.cwiseProduct(force_axes_);
  const double magnitude = norm_of(force);
  if (magnitude > strongest_) force *= strongest_ / magnitude;
  const Vec3 motor = plant_.rotation() * force;
  return force_resolution_ > 0 ? quantised(motor, force_resolution_) : motor;
}

/// Returns the command of the wrist's motors: saturated.
Vec3 SimDevice::wrist_command(const Wrench& wrench) const noexcept {
  const Vec3 torque = sendable(wrench).torque;
  const double magnitude = norm_of(torque);
  return magnitude > wrist_->max_torque ? Vec3(torque * (wrist_->max_torque / magnitude)) : torque;
}

/// Advances the plant in stretches with a constant motor command and a linear hand force and intent.
void SimDevice::advance(std::int64_t now, std::int64_t end) noexcept {
  while (now < end) {
    if (now >= lets_go_) {
      plant_.let_go();
      if (wrist_) wrist_->body.let_go();
    }
    const std::int64_t until = std::min({end, delay_line_.next(), hand_acts_ ? hand_tick_ : DelayLine::kNever,
                                         now < lets_go_ ? lets_go_ : DelayLine::kNever});
    const double span = 1e-9 * static_cast<double>(until - now);
    plant_.advance(span, input_);
    if (wrist_) turn(now, span);
    now = until;
    delay_line_.arrive(now);
    input_.command = delay_line_.output();
    if (!hand_acts_) continue;
    if (now == hand_tick_) {
      plan_hand();
    } else {
      input_.hand_force += span * input_.hand_force_rate;
      input_.intent += span * input_.intent_velocity;
    }
  }
}

/// Force and torque commands have the same delay, so no torque arrives within a stretch.
void SimDevice::turn(std::int64_t now, double span) noexcept {
  wrist_->torque.arrive(now);
  if (!wrist_->intent.empty())
    wrist_->intended = wrist_->intent.sample(1e-9 * static_cast<double>(now), wrist_->intent_cursor).orientation;
  wrist_->body.advance(span, wrist_->torque.output(), wrist_->intended);
}

void SimDevice::plan_hand() noexcept {
  hand_tick_ += kHandPeriod;
  input_.hand_force = next_hand_force_;
  next_hand_force_ = tremor_.next(hand_noise_) + drift_.next(hand_noise_);
  input_.hand_force_rate = kHandRate * (next_hand_force_ - input_.hand_force);
  input_.intent = next_intent_;
  if (steering_ != nullptr) follow_person();
  if (intent_.size() > 0) {
    next_intent_ = plant_.rotation() * intent_.sample(1e-9 * static_cast<double>(hand_tick_), intent_cursor_).position;
    input_.intent_velocity = kHandRate * (next_intent_ - input_.intent);
  }
}

void SimDevice::follow_person() noexcept {
  HandIntention intention = steering_->latest();
  // Neither a bound nor a rotation may turn NaN into a place.
  if (is_finite(intention.position)) {
    const Vec3 beyond = Vec3::Constant(kBeyond);
    intention.position =
        plant_.rotation() *
        intention.position.cwiseMax(info_.workspace_min - beyond).cwiseMin(info_.workspace_max + beyond);
  }
  const bool held = steered_.grip() > 0;
  steered_.update(intention, clock_ns_, plant_.hand_position(), 1 / kHandRate);
  plant_.follow_intent(steered_.grip());
  next_intent_ = steered_.position();
  // A hand that takes hold has no velocity from before.
  if (!held) input_.intent = next_intent_;
  input_.intent_velocity = kHandRate * (next_intent_ - input_.intent);
}

void SimDevice::measure(DeviceState& state) noexcept {
  state = DeviceState{};
  Vec3 position = plant_.motor_position();
  if (position_noise_ > 0) position += position_noise_ * sensor_noise_.vector();
  if (info_.position_resolution > 0) position = quantised(position, info_.position_resolution);
  state.position = to_world(position);
  if (wrist_) {
    const Quat& orientation = wrist_->body.orientation();
    const double quantum = wrist_->resolution;
    state.orientation = quantum > 0 ? quaternion(quantised(rotation_vector(orientation), quantum)) : orientation;
  }
  if (info_.measures_force) {
    state.force = to_world(plant_.contact_force());
    if (force_noise_ > 0) state.force += force_noise_ * sensor_noise_.vector();
  }
}

namespace {

using nlohmann::json;

constexpr double kNoLimit = std::numeric_limits<double>::infinity();

/// Returns the preset, modified by the file, with the hand: each option overrides the previous one.
json merged_spec(const DeviceSpec& device) {
  const std::string file = device.option("spec"), hand = device.option("hand");
  const std::string preset = device.option("preset").empty() && file.empty() ? "reference" : device.option("preset");

  json spec = json::object();
  if (!preset.empty()) spec = device_preset(preset, device.where() + ": preset");
  if (!file.empty()) spec.merge_patch(load_json(file));
  if (!hand.empty()) {
    // A hand from the command line follows the intent of the file's own hand.
    const json own = spec.contains("hand") && spec["hand"].is_object() ? spec["hand"] : json::object();
    spec["hand"] = hand == "none" ? json(hand) : hand_preset(hand, device.where() + ": hand");
    if (hand != "none" && own.contains("intent")) spec["hand"]["intent"] = own["intent"];
  }
  if (!device.option("intent").empty() && !spec.contains("hand")) spec["hand"] = "relaxed";
  return spec;
}

/// Returns eight hexadecimal digits that identify the device, whatever its hand (FNV-1a).
std::string serial_number(json spec) {
  spec.erase("hand");
  std::uint32_t hash = 2166136261;
  for (const char c : spec.dump()) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619;
  return fmt::format("{:08x}", hash);
}

/// Returns the same path, delayed by `after` [s] and `speed` times as fast.
Path retimed(const Path& path, double after, double speed) {
  Path result{.name = path.name};
  if (after > 0 && path.size() > 0) {
    result.time.push_back(0);
    result.position.push_back(path.position.front());
    if (!path.orientation.empty()) result.orientation.push_back(path.orientation.front());
  }
  for (std::size_t i = 0; i < path.size(); ++i) {
    result.time.push_back(after + (path.time[i] - path.time.front()) / speed);
    result.position.push_back(path.position[i]);
    if (!path.orientation.empty()) result.orientation.push_back(path.orientation[i]);
  }
  return result;
}

SimPathReader path_reader = nullptr;

/// Sets the hand's intent, and the notes about it for the user.
void read_intent(const DeviceSpec& device, const SimSpec& spec, SimOptions& options) {
  const bool fit = device.flag("fit");
  if (path_reader == nullptr)
    throw input_error(device.where() + ": intent: this program cannot read paths; call use_recorded_devices() first");
  Path path = path_reader(spec.hand->intent);
  for (const std::string& note : path.notes) options.notes.push_back(fmt::format("{}: {}", path.name, note));
  const double outside = distance_outside(path, spec.workspace);
  if (outside > 0) {
    if (!fit)
      throw input_error(
          fmt::format("{}: the hand's intent leaves the workspace of the {} by {:.1f} mm; --fit (or fit=true among the "
                      "options of --device) scales and moves it inside",
                      spec.hand->intent, spec.model, 1000 * outside));
    const Fit change = fit_into(path, spec.workspace);
    apply(change, path);
    options.notes.push_back(
        fmt::format("{}: fitted into the workspace of the {}: {}", path.name, spec.model, describe(change)));
  }
  const double after = device.number("intent_after", 0.0, kNoLimit, 0.0, "s"),
               speed = device.number("intent_speed", 0.01, 100.0, 1.0);
  if (after > 0 || speed != 1) path = retimed(path, after, speed);
  options.intent = Trajectory(path, Interpolation::cubic);
  if (spec.wrist && !path.orientation.empty())
    options.intent_orientation = OrientationTrajectory(path, Interpolation::cubic, path.time.front(), path.time.back());
}

}  // namespace

void set_sim_path_reader(SimPathReader reader) noexcept {
  path_reader = reader;
}

SimParts read_sim_device(const DeviceSpec& device) {
  const std::string file = device.option("spec"), intent = device.option("intent");
  const json json_spec = merged_spec(device);
  SimSpec spec = read_sim_spec(json_spec, file.empty() ? device.where() : file,
                               std::filesystem::path(file).parent_path().string());
  if (!intent.empty() && !spec.hand)
    throw input_error(device.where() + ": intent: no hand holds the device (hand=none), so none can follow a path");
  if (!intent.empty()) spec.hand->intent = intent;

  SimOptions options{
      .name = device.text,
      .serial = serial_number(json_spec),
      .seed = device.number<std::uint64_t>("seed", 0, std::numeric_limits<std::uint64_t>::max(), SimOptions{}.seed),
      .intent = {}};
  options.lost_at = device.number("lost_at", 0.0, kNoLimit, SimOptions::kNever, "s");
  options.lost_for = device.number("lost_for", 0.0, kNoLimit, SimOptions::kNever, "s");
  if (options.lost_for < SimOptions::kNever && options.lost_at == SimOptions::kNever)
    throw input_error(device.where() + ": lost_for: the time of the loss is missing; set it with lost_at");
  options.longest_step = device.number("step", kShortestOption, kLongestOption, options.longest_step, "s");
  options.integrator = parse_integrator(device.option("integrator", to_string(options.integrator)));
  if (spec.hand && intent == kIntentOfView) {
    for (const char* key : {"intent_after", "intent_speed", "fit"})
      if (!device.option(key).empty())
        throw input_error(fmt::format("{}: {} applies to the path of a hand, but a person steers this one (intent={})",
                                      device.where(), key, kIntentOfView));
    spec.hand->intent.clear();
    options.steering = &view_steering();
  }
  if (spec.hand && !spec.hand->intent.empty()) read_intent(device, spec, options);
  return {std::move(spec), std::move(options)};
}

std::unique_ptr<SimDevice> open_sim_device(const DeviceSpec& device) {
  const SimParts parts = read_sim_device(device);
  return std::make_unique<SimDevice>(parts.spec, parts.options);
}

DeviceBackend sim_backend() {
  return {
      .name = "sim",
      .summary = "a simulated device in virtual time, held by a simulated hand",
      .options =
          {{"preset", "preset of the device, from the list (default reference)"},
           {"spec", "JSON file of the device; with preset, only the changes"},
           {"hand", fmt::format("simulated hand that holds the device: {}", fmt::join(hand_preset_names(), ", "))},
           {"intent",
            "path that the hand intends to follow: CSV or HDF5; view: the live view's mouse, pen, touch or gamepad"},
           {"intent_after", "time at which the hand starts to follow it, on the device's clock (default 0) [s]"},
           {"intent_speed", "factor on the speed of the path (default 1)"},
           {"fit", "true: scale and move the intent into the workspace"},
           {"seed", "seed of tremor and noise (default 1)"},
           {"integrator", "integration method: semi-implicit (default), euler, verlet, rk4, implicit, exact"},
           {"step", "longest integration step; stiff parts shorten it (default 5e-5) [s]"},
           {"lost_at", "time at which the simulated cable is unplugged, on the device's clock [s]"},
           {"lost_for", "time for which the cable stays unplugged (default: until the device is opened again) [s]"}},
      .presets = device_preset_names(),
      .open = [](const DeviceSpec& device) -> std::unique_ptr<Device> { return open_sim_device(device); }};
}

}  // namespace haptrace
