#include "studies/trade/workbench.h"

#include "base/error.h"
#include "base/statistics.h"
#include "base/stopwatch.h"
#include "control/oscillation_count.h"
#include "control/velocity_estimator.h"
#include "devices/loop/servo_loop.h"
#include "formats/recording/recording_stream.h"
#include "formats/recording/storage_report.h"
#include "player/device_path.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "studies/trade/instruction_count.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr double kForceBin = 0.02;      // averaging time of compared forces [s]
constexpr int kMarginSteps = 8;         // steps of a quarter octave
constexpr double kLearnedStep = 0.004;  // time step of a learned force [s]

/// Replays the positions of an earlier session at no computing cost.
class SeenDevice final : public Device {
 public:
  SeenDevice(DeviceInfo info, const std::vector<Vec3>& seen) : info_(std::move(info)), seen_(seen) {
    info_.virtual_time = true;
    info_.measures_orientation = info_.measures_force = false;
    info_.torque_axes = {false, false, false};
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench&, double, DeviceState& state) noexcept override {
    state = DeviceState{};
    state.position = seen_[std::min(next_++, seen_.size() - 1)];
    return Status::ok;
  }
  void close() noexcept override {}

 private:
  DeviceInfo info_;
  const std::vector<Vec3>& seen_;
  std::size_t next_ = 0;
};

/// Marks consecutive ticks of phase run and ends the session at the last.
class MarkedController final : public Controller {
 public:
  MarkedController(Controller& controller, std::uint64_t first, std::uint64_t count)
      : controller_(controller), first_(first), last_(first + count) {}

  void use(const std::function<void()>& mark) noexcept { mark_ = &mark; }
  void start(const State& first) noexcept override { controller_.start(first); }
  void between_ticks(bool may_wait) noexcept override { controller_.between_ticks(may_wait); }
  [[nodiscard]] Command update(const State& state) noexcept override {
    if (running_ >= first_ && running_ <= last_) (*mark_)();
    Command command = controller_.update(state);
    if (command.phase == Phase::run) ++running_;
    if (running_ > last_) command.status = Command::Status::finished;
    return command;
  }

 private:
  Controller& controller_;
  const std::function<void()>* mark_ = nullptr;
  std::uint64_t first_, last_, running_ = 0;
};

Path whole_path(const PathSource& source) {
  Path path = source.read(0, source.facts().rows);
  path.name = source.facts().name;
  return path;
}

/// A file that the destructor removes.
class ScratchFile {
 public:
  explicit ScratchFile(const char* what)
      : name_((std::filesystem::temp_directory_path() / fmt::format("haptrace-{}-{}.h5", what, getpid())).string()) {}
  ~ScratchFile() {
    std::error_code ignored;
    std::filesystem::remove(name_, ignored);
  }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;
  [[nodiscard]] const std::string& name() const noexcept { return name_; }

 private:
  std::string name_;
};

}  // namespace

/// Accumulates errors and forces of the last repetition.
class Workbench::RunLog final : public SampleSink {
 public:
  RunLog(const Trajectory& exact, double speed) : exact_(exact), speed_(speed) {
    force_.assign(static_cast<std::size_t>(exact.duration() / speed / kForceBin) + 2, Vec3::Zero());
    count_.assign(force_.size(), 0);
  }

  void push(const Event& event) noexcept override {
    if (event.code != EventCode::repetition) return;
    squares_ = largest_ = 0;
    samples_ = 0;
    std::fill(force_.begin(), force_.end(), Vec3::Zero());
    std::fill(count_.begin(), count_.end(), 0);
  }

  void push(const Sample& sample) noexcept override {
    if (sample.phase != Phase::run) return;
    if (samples_++ == 0) begin_ns_ = sample.time_ns;
    const double time = 1e-9 * static_cast<double>(sample.time_ns - begin_ns_);
    const Vec3 place = exact_.sample(speed_ * time, cursor_).position;
    const double squared = (sample.position - place).squaredNorm();
    squares_ += squared;
    largest_ = std::max(largest_, squared);
    const auto bin = std::min(static_cast<std::size_t>(time / kForceBin), force_.size() - 1);
    force_[bin] += sample.force;
    ++count_[bin];
  }

  [[nodiscard]] double rms() const { return samples_ > 0 ? std::sqrt(squares_ / static_cast<double>(samples_)) : kNaN; }
  [[nodiscard]] double peak() const { return std::sqrt(largest_); }
  [[nodiscard]] std::vector<Vec3> forces() const {
    std::vector<Vec3> means;
    for (std::size_t i = 0; i < force_.size(); ++i)
      means.push_back(count_[i] > 0 ? Vec3(force_[i] / static_cast<double>(count_[i])) : nan3());
    return means;
  }

 private:
  const Trajectory& exact_;
  double speed_;
  Trajectory::Cursor cursor_;
  std::int64_t begin_ns_ = 0;
  double squares_ = 0, largest_ = 0;
  std::uint64_t samples_ = 0;
  std::vector<Vec3> force_;
  std::vector<int> count_;
};

/// A session that was played once and can run again on a device that replays its positions at no computing cost.
class Workbench::Rehearsal final : SampleSink {
 public:
  Rehearsal(Device& device, PlayPlan plan, const PlayOptions& options, double path_duration)
      : info_(device.info()), plan_(std::move(plan)), options_(options) {
    const double seconds = path_duration / options.playback.speed + options.playback.hold + 60;
    seen_.reserve(static_cast<std::size_t>(seconds * options.session.loop.rate_hz));
    PlayOptions watched = options;
    watched.sinks.push_back(this);
    played_ = play(device, plan_, watched, StopRequest{}).session.servo;
  }

  [[nodiscard]] std::uint64_t ticks() const noexcept { return seen_.size(); }
  [[nodiscard]] std::uint64_t ticks_of_the_path() const noexcept { return running_; }
  [[nodiscard]] const ServoReport& played() const noexcept { return played_; }
  [[nodiscard]] PlaybackController controller() const { return playback_controller(info_, plan_, options_); }

  ServoReport again(Controller& controller) const {
    SeenDevice seen(info_, seen_);
    const SessionOptions& session = options_.session;
    const auto estimator = make_velocity_estimator(session.velocity, session.loop.rate_hz, info_.position_resolution);
    return ServoLoop(seen, controller, *estimator, {},
                     {.rate_hz = session.loop.rate_hz, .virtual_time = true, .limits = session.loop.limits})
        .run(StopRequest{});
  }

 private:
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    if (seen_.size() < seen_.capacity()) seen_.push_back(sample.position);
    if (sample.phase == Phase::run) ++running_;
  }

  DeviceInfo info_;
  PlayPlan plan_;
  PlayOptions options_;
  ServoReport played_;
  std::vector<Vec3> seen_;
  std::uint64_t running_ = 0;
};

Workbench::Workbench(Workplace place) : place_(std::move(place)) {
  const auto device = place_.open(place_.seed);
  info_ = device->info();
  if (!info_.virtual_time)
    throw input_error(fmt::format(
        "{} does not advance in virtual time; configurations are tested on a simulated device", info_.name));
  place_.path = source_of(whole_path(*place_.path));
  place_.play.session.clock = ClockChoice::virtual_time;
  place_.play.session.recording.reset();
  const PlayPlan plan = plan_playback(info_, place_.path, place_.play);
  exact_ = plan.path->first()->trajectory;
  if (plan.path->count() > 1) {
    const TrajectoryPieces whole(
        path_for(info_, place_.path, place_.play.fit).source, Interpolation::cubic,
        {.undivided = std::numeric_limits<std::uint64_t>::max(), .smoothing = place_.play.smoothing});
    exact_ = whole.first()->trajectory;
  }
}

std::optional<DeviceProfile> Workbench::profile_at(double rate_hz) const {
  if (!place_.profile) return std::nullopt;
  DeviceProfile profile = *place_.profile;
  if (std::abs(rate_hz - profile.rate_hz) <= kProfileRateTolerance * profile.rate_hz) return profile;
  if (profile.coarse) return std::nullopt;
  try {
    profile.design = design_tracking(profile.plant, {.rate_hz = rate_hz, .max_force = profile.facts.max_force});
  } catch (const Error&) {
    return std::nullopt;  // the delay is too long for this rate
  }
  profile.held.reset();  // its laws were searched for the profile's rate
  profile.rate_hz = rate_hz;
  return profile;
}

PlayOptions Workbench::options_for(const Configuration& configuration) const {
  PlayOptions options = play_options(configuration, place_.play);
  options.identified.reset();
  options.find_oscillations = true;
  if (place_.profile) {
    const std::optional<DeviceProfile> profile = profile_at(configuration.rate_hz);
    if (!profile)
      throw input_error(fmt::format("the calibration at {:g} Hz allows no control law at {:g} Hz",
                                    place_.profile->rate_hz, configuration.rate_hz));
    options.identified = profile->identified();
    if (is_lqg(configuration.law) && !profile->held)
      throw input_error(fmt::format("the profile has no LQG laws for {:g} Hz", configuration.rate_hz));
  }
  return options;
}

bool Workbench::has_laws(double rate_hz) const {
  const std::optional<DeviceProfile> profile = profile_at(rate_hz);
  return profile && profile->held;
}

Outcome Workbench::judge(const Configuration& configuration, std::size_t runs) const {
  Outcome outcome{.configuration = configuration};
  std::vector<double> error, peak, rms, measured_peak, force, ripple, max_force;
  try {
    const PlayOptions base = options_for(configuration);
    for (std::size_t run = 0; run < runs; ++run) {
      const std::uint64_t seed = place_.seed + run;
      const auto device = place_.open(seed);
      PlayOptions options = base;
      RunLog log(exact_, configuration.speed);
      options.sinks.push_back(&log);
      const PlayResult result =
          play(*device, plan_playback(device->info(), place_.path, options), options, StopRequest{});
      if (result.session.servo.cause != StopCause::finished) {
        outcome.refused =
            result.session.servo.detail.empty() ? to_string(result.session.servo.cause) : result.session.servo.detail;
        return outcome;
      }
      error.push_back(log.rms());
      peak.push_back(log.peak());
      rms.push_back(result.last.rms_error);
      measured_peak.push_back(result.last.peak_error);
      ripple.push_back(result.last.force_ripple);
      max_force.push_back(result.last.max_force);
      outcome.duration = result.session.servo.duration;
      if (const auto finest = finest_force_.find(seed); finest != finest_force_.end())
        force.push_back(force_difference(log.forces(), finest->second));
      ++outcome.runs;
    }
  } catch (const Error& refused) {
    outcome.refused = refused.what();
    return outcome;
  }
  const auto estimate = [&](const std::vector<double>& values) {
    Estimate of = Estimate::of(values);
    if (!place_.varies) of.half_width = 0;
    of.half_width = std::hypot(of.half_width, place_.model_error * of.mean);
    return of;
  };
  outcome.error = estimate(error);
  outcome.peak = estimate(peak);
  outcome.rms_error = estimate(rms);
  outcome.peak_error = estimate(measured_peak);
  if (!force.empty()) outcome.force = estimate(force);
  outcome.ripple = estimate(ripple);
  outcome.max_force = estimate(max_force);
  return outcome;
}

double Workbench::force_difference(const std::vector<Vec3>& forces, const std::vector<Vec3>& finest) {
  if (forces.size() != finest.size()) return kNaN;
  double squares = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < forces.size(); ++i) {
    if (!is_finite(forces[i]) || !is_finite(finest[i])) continue;
    squares += (forces[i] - finest[i]).squaredNorm();
    ++count;
  }
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : kNaN;
}

void Workbench::measure_forces_against(const Configuration& finest, std::size_t runs, const StopRequest& stop) {
  finest_force_.clear();
  for (std::size_t run = 0; run < runs && stop.count() == 0; ++run) {
    const std::uint64_t seed = place_.seed + run;
    const auto device = place_.open(seed);
    PlayOptions options = options_for(finest);
    RunLog log(exact_, finest.speed);
    options.sinks.push_back(&log);
    (void)play(*device, plan_playback(device->info(), place_.path, options), options, StopRequest{});
    finest_force_[seed] = log.forces();
  }
}

void Workbench::find_margin(Outcome& outcome) const {
  if (!outcome.ran()) return;
  PlayOptions base = options_for(outcome.configuration);
  base.learn = 0;
  base.compensations.learning = false;
  base.playback.repetitions = 1;
  const auto bears = [&](int steps) {
    PlayOptions options = base;
    const auto device = place_.open(place_.seed);
    const double factor = std::pow(2, 0.25 * steps);
    const PdGains gains = plan_playback(device->info(), place_.path, options).tuning.gains;
    options.gains = PdGains{(factor * gains.kp).cwiseMin(kLargestKp), (factor * gains.kd).cwiseMin(kLargestKd)};
    OscillationCount oscillations;
    options.sinks.push_back(&oscillations);
    const PlayResult result =
        play(*device, plan_playback(device->info(), place_.path, options), options, StopRequest{});
    return result.session.servo.cause == StopCause::finished && oscillations.count() == 0;
  };
  int low = -1, high = kMarginSteps + 1;  // stable, not stable
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    (bears(middle) ? low : high) = middle;
  }
  outcome.margin = low < 0 ? 0 : std::pow(2, 0.25 * low);
}

/// Returns options for one repetition with zeros as learned forces: the same work per tick without learning.
PlayOptions Workbench::tick_options(const Configuration& configuration) const {
  PlayOptions options = options_for(configuration);
  if (configuration.learn > 0) {
    const double step = kLearnedStep * configuration.speed;
    options.learned = {.step = step,
                       .force = std::vector<Vec3>(static_cast<std::size_t>(duration() / step) + 2, Vec3::Zero())};
  }
  options.learn = 0;
  options.playback.repetitions = 1;
  return options;
}

void Workbench::time_ticks(Outcome& outcome) const {
  if (!outcome.ran()) return;
  const PlayOptions options = tick_options(outcome.configuration);
  const auto device = place_.open(place_.seed);
  std::vector<double> starts;
  for (int i = 0; i < 3; ++i) {
    const Stopwatch watch;
    const PlayPlan plan = plan_playback(info_, place_.path, options);
    (void)playback_controller(info_, plan, options);
    starts.push_back(watch.seconds());
  }
  std::sort(starts.begin(), starts.end());
  outcome.start = starts[1];

  const Rehearsal session(*device, plan_playback(info_, place_.path, options), options, duration());
  if (session.ticks() == 0) return;
  PlaybackController controller = session.controller();
  outcome.control = session.again(controller).tick_time.quantile(0.5);
  outcome.tick = place_.device_in_tick ? session.played().tick_time.quantile(0.5) : outcome.control;
}

double Workbench::count_ticks(const Configuration& configuration) const {
  const PlayOptions options = tick_options(configuration);
  PlayPlan plan = plan_playback(info_, place_.path, options);
  // A path of several pieces needs its reading thread, which a copy of this process would not have.
  if (plan.path->count() > 1) return kNaN;
  const auto device = place_.open(place_.seed);
  const Rehearsal session(*device, std::move(plan), options, duration());
  if (session.ticks_of_the_path() < 2 * kCountedTicks) return kNaN;

  PlaybackController controller = session.controller();
  MarkedController marked(controller, session.ticks_of_the_path() / 4, kCountedTicks);
  std::vector<std::uint64_t> counted = count_instructions(
      [&](const std::function<void()>& mark) {
        marked.use(mark);
        (void)session.again(marked);
      },
      kCountedTicks);
  if (counted.empty()) return kNaN;
  // Lower quartile: single steps are so slow that the kernel's clock often changes during a read and is read again, on
  // a busy machine in more than half of the ticks.
  return quantile({counted.begin(), counted.end()}, 0.25);
}

Workbench::Stored Workbench::record(const Configuration& configuration, const Storage& storage) const {
  const auto run = [&](const Storage& kept, const std::string& file) {
    PlayOptions options = tick_options(configuration);
    if (!file.empty()) {
      SessionOptions::Recording recording{.file = file};
      recording.options.overwrite = true;
      recording.options.storage = kept;
      recording.options.tell_room = false;
      options.session.recording = recording;
    }
    const auto device = place_.open(place_.seed);
    const PlayPlan plan = plan_playback(device->info(), place_.path, options);
    const CpuStopwatch watch(CpuStopwatch::Of::process);
    const PlayResult result = play(*device, plan, options, StopRequest{});
    if (!result.session.recording_error.empty()) throw Error(Error::Kind::fault, result.session.recording_error);
    if (result.session.servo.cause != StopCause::finished) throw Error(Error::Kind::fault, result.session.servo.detail);
    return watch.seconds() / static_cast<double>(std::max<std::uint64_t>(result.session.servo.samples, 1));
  };
  const ScratchFile original("original"), stored("stored");
  const double without = run({}, "");
  (void)run({}, original.name());
  Stored result{.bytes_per_hour = 0};
  result.row_time = run(storage, stored.name()) - without;
  const auto source = open_source(original.name());
  for (const StoredColumn& column : report_storage(stored.name(), *source)) {
    result.bytes_per_hour += column.bytes_per_hour;
    if (column.name == "position") result.position_error = column.max_loss;
    if (column.name == "force") result.force_error = column.max_loss;
  }
  return result;
}

}  // namespace haptrace
