// A tracking law, and plain PD control as its stand-in.
#pragma once

#include "control/force_term.h"

#include <memory>

namespace haptrace {

/// The feedback of a law, until it vibrates. A monitor then softens it, and it follows worse than plain PD control for
/// the rest of the session. From the approach to the next repetition on, plain PD control stands in for it, with the
/// gains that the device bore in the trials of its calibration. Within kBlend, the force changes from one to the other.
///
/// Tuned gains apply to both: relative to the law's own gains, they are the same multiple of the plain ones.
///
/// Real-time: all but the constructor.
class StandInLaw final : public ForceTerm {
 public:
  static constexpr double kBlend = 0.5;  ///< [s]

  /// `own`: the gains of a tuning under which `law` acts as designed. `plain`: those of PD control.
  StandInLaw(std::unique_ptr<ForceTerm> law, const PdGains& own, const PdGains& plain);

  void start(const State& first) noexcept override;
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;
  [[nodiscard]] PdGains gains(const Tuning& tuning) const noexcept override;
  [[nodiscard]] bool renewed() const noexcept override { return renewed_; }
  void between_ticks(bool may_wait) noexcept override { law_->between_ticks(may_wait); }

 private:
  [[nodiscard]] PdGains plain_of(const Tuning& tuning) const noexcept {
    return {share_.kp.cwiseProduct(tuning.gains.kp), share_.kd.cwiseProduct(tuning.gains.kd)};
  }

  std::unique_ptr<ForceTerm> law_;
  PdGains share_;  ///< plain gains over those of the law; 0 on axes without a law
  bool on_path_ = false, stands_in_ = false, renewed_ = false;
  double weight_ = 0;  ///< of plain PD control
};

}  // namespace haptrace
