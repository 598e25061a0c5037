#include "player/calibration/hand_listening.h"

#include "player/record_controllers.h"

#include <vector>

namespace haptrace {
namespace {

class ListenedRows final : public SampleSink {
 public:
  explicit ListenedRows(double rate_hz) { rows_.reserve(static_cast<std::size_t>((kListening + 1) * rate_hz)); }

  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    if (rows_.size() < rows_.capacity())
      rows_.push_back({1e-9 * static_cast<double>(sample.time_ns), sample.position, sample.force});
  }

  [[nodiscard]] const std::vector<TickRow>& rows() const noexcept { return rows_; }

 private:
  std::vector<TickRow> rows_;
};

}  // namespace

Listened listen_to_hand(Device& device, const CalibrationPlan& plan, const Vec3& mass, const SessionOptions& session,
                        const StopRequest& stop, const Progress& progress) {
  PassiveController passive;
  TimedController timed(passive, kListening);
  ListenedRows rows(plan.rate_hz);
  SampleSink* const sinks[] = {&rows};
  SessionOptions quiet = session;
  quiet.recording.reset();
  Listened result{.held = held_model({.mass = mass}, kRelaxedHand)};
  result.ended = run_session(device, timed, {}, sinks, quiet, stop, progress).servo.cause;
  if (result.ended != StopCause::finished) return result;
  // Whole windows between the multiples of the signal's period, though the signal is silent.
  const Experiment experiment{.rows = rows.rows(),
                              .rate_hz = plan.rate_hz,
                              .axes = plan.axes,
                              .dither = &plan.dither,
                              .dithered = {{0, rows.rows().size()}},
                              .centre = plan.centre,
                              .places = {},
                              .sweeps = {},
                              .pulsed = {}};
  const PlantModel rigid{.mass = mass, .position_resolution = position_quantum(rows.rows())};
  result.held.noise = identify_hand_noise(experiment, result.held, rigid).noise;
  return result;
}

}  // namespace haptrace
