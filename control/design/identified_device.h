// The results of a calibration of a device: models, and designs of laws for them.
#pragma once

#include "base/stop_request.h"
#include "control/design/hand_noise.h"
#include "control/design/held_model.h"
#include "control/design/identification.h"
#include "control/design/lqg_search.h"
#include "control/design/tracking_design.h"
#include "control/inertia_map.h"

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// Where the hand of a model comes from.
enum class HandKnown : std::uint8_t {
  identified,  ///< from the response of the device
  nobody,      ///< the response is that of a free device; the laws expect kHardlyAHand
  assumed,     ///< the response does not tell; the laws expect kRelaxedHand
};

const char* to_string(HandKnown known) noexcept;
HandKnown parse_hand_known(std::string_view name);  ///< throws Error(input)

/// The laws of one firmness, as the numbers from which lqg_laws() follows, and what the search predicts of them.
struct LqgDesign {
  std::array<std::optional<LqgNumbers>, 3> numbers;  ///< for the axes that are driven
  LoopFigures figures;                               ///< magnitude over the axes
  std::vector<std::string> unmet;                    ///< requirements that the search could not meet, with their axis
  LawVerdict verdict;
};

/// A device in a hand and the laws for it.
struct HeldDevice {
  HeldModel model;
  HeldModel half_width;  ///< half widths of the 95 % confidence intervals; zero where there is none
  HandKnown hand = HandKnown::assumed;
  double margin = 0;                  ///< evidence for the hand, see HeldIdentification
  double position_noise = 0;          ///< standard deviation of a measured position [m]
  double ripple = 0;                  ///< ripple of which the laws may use a share, rms per axis [N]
  std::optional<InertiaMap> inertia;  ///< if the mass varies over the workspace
  /// Mass for which the laws are designed, over that at the centre. A law designed for the centre, where a device may
  /// be heaviest, would leave most of its ripple unused elsewhere.
  Vec3 designed_for = Vec3::Ones();
  bool one_mass = true;  ///< nothing is known about it: the laws bear a mass that differs by a third
  std::array<LqgDesign, kFirmnesses.size()> designs;

  [[nodiscard]] const LqgDesign& design(Firmness firmness) const noexcept {
    return designs[static_cast<std::size_t>(firmness)];
  }
  /// Returns the smallest and the largest mass in the workspace, per axis, over that for which the laws are designed.
  [[nodiscard]] std::pair<Vec3, Vec3> mass_range() const noexcept;

  [[nodiscard]] LqgDesign& design(Firmness firmness) noexcept { return designs[static_cast<std::size_t>(firmness)]; }
};

/// Models and designs of a calibrated device.
struct IdentifiedDevice {
  PlantModel plant;
  TrackingDesign design;           ///< of the law with an observer, and of a plain one
  std::optional<HeldDevice> held;  ///< for LQG laws, if there are any
};

/// Returns the model of a device for the laws, without these. `max_force` is the device's largest force [N]. Laws may
/// use as much ripple as a plain PD law makes (haptrace::plain_ripple) and more where this is hardly felt, kFineRipple.
/// They never use more than kMostLawRipple of the device's force: where one count of a coarse encoder asks for more, a
/// law would chatter between two counts harder than the servo loop lets it.
HeldDevice held_device(const Identification& identified, const HeldIdentification& held, double rate_hz,
                       double max_force);
inline constexpr double kFineRipple = 0.15;    ///< magnitude [N]
inline constexpr double kMostLawRipple = 0.1;  ///< magnitude, share of the largest force

/// Notes the tremor that was found. Holding a device against it takes force above 25 Hz, which the laws may use too.
void expect_tremor(const HandNoiseIdentification& found, double max_force, HeldDevice& device);

/// Returns the peaks of the force with which a law may answer the tremor of the identified hand [N]: kMostAnswer times
/// the tremor's rms at motors that hold still. In 72 playbacks under laws on random devices with a tremor of 0.5 N, the
/// largest peaks that the slow rule of VibrationMonitor saw in 20 s were 5.8 times that (median), and at most 8.2.
double answer_to_tremor(const HeldModel& held) noexcept;
inline constexpr double kMostAnswer = 8;

/// Searches the laws of all firmnesses for the model of `device`. Returns false if `stop` was raised; the designs are
/// then incomplete. `progress` receives the share that is done, in the calling thread. Throws what search_lqg() throws.
bool design_laws(HeldDevice& device, double rate_hz, const StopRequest& stop,
                 const std::function<void(double)>& progress = {});

/// Returns the laws of a firmness, at this rate of the servo loop. Throws Error(input) if a model or a number is out of
/// its range. Allocates, and takes milliseconds.
std::array<std::optional<LqgLaws>, 3> lqg_laws(const HeldDevice& device, Firmness firmness, double rate_hz);

}  // namespace haptrace
