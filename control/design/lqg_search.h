// Search of an LQG law that stays stable with other hands and devices than those of its model.
#pragma once

#include "base/stop_request.h"
#include "control/design/lqg_design.h"

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// How much ripple a law may use: the more, the smaller its error.
enum class Firmness : std::uint8_t { quiet, normal, exact };
inline constexpr std::array kFirmnesses{Firmness::quiet, Firmness::normal, Firmness::exact};

const char* to_string(Firmness firmness) noexcept;
Firmness parse_firmness(std::string_view name);  ///< throws Error(input)

/// The numbers that the search varies. They turn an identified model into that of a law.
struct LqgNumbers {
  double drift = 0.2;           ///< s_d, standard deviation of the hand's drift [N]
  double drift_hz = 1.1;        ///< f_d, corner of the drift [Hz]
  double force_noise = 0.007;   ///< q_w, white force on the device [N sqrt(s)]
  double ripple_weight = 7e-8;  ///< rho [m^2/N^2]
  double mass_factor = 0.95;    ///< mu, on the identified mass
  double hand_share = 0.5;      ///< alpha, on the identified hand's mass, grip stiffness and grip damping
};

/// Designs the law of `numbers` for an identified axis. Returns nothing if there is none, and throws, like
/// design_lqg().
std::optional<LqgAxis> design_lqg(const AxisModel& identified, const LqgNumbers& numbers);

/// Designs the feedback of an identified axis for rest. The friction of a device that rests is a spring, stiff enough
/// to put a small device at 30 to 50 Hz (see ObserverPd). A law for movement takes this spring for a load and damps it
/// late, which drives the device instead. At rest, the filter therefore expects a white force of 0.25 N sqrt(s) per
/// kilogram and no hand, which makes it fast, and the feedback is as soft as `max_ripple` requires [N]. The loop is
/// then stable on springs up to 50 Hz if the force acts within two periods; a kilogram that answers after three is
/// stable up to 15 Hz only. Returns nothing and throws like design_lqg().
std::optional<LqgAxis> design_lqg_for_rest(const AxisModel& identified, double max_ripple);

/// Returns the highest frequency [Hz], from kLeastLearning to kMostLearning, up to which iterative learning converges
/// under `law` although the load of a hand moves with the error. With P the response of the device in the hand, P_0
/// that of the device alone and S the sensitivity, learning takes |1 - P / P_0| |S| of an error for load. Below 1, the
/// error shrinks. Learning also takes the noise of the measured positions for accelerations of the mass: the bandwidth
/// is such that white noise makes at most `max_noise` of learned force, rms [N].
double learning_bandwidth(const AxisModel& identified, const LqgAxis& law, double max_noise);
inline constexpr double kLeastLearning = 15, kMostLearning = 30;  ///< [Hz]

/// Designs both laws of an identified axis; the one for rest may make as much ripple as a normal one for movement, of
/// `plain_ripple` [N]. Returns nothing and throws like design_lqg().
std::optional<LqgLaws> lqg_laws(const AxisModel& identified, const LqgNumbers& numbers, double plain_ripple);

struct LqgSearchOptions {
  Firmness firmness = Firmness::normal;
  double plain_ripple = 0;               ///< ripple of which the law may use a share, rms per axis [N]; 0: that of a
                                         ///< plain PD law (haptrace::plain_ripple)
  double lighter = 0.85, heavier = 1.2;  ///< range of the mass that the law must bear, over the identified mass
  double least = 1, most = 1;            ///< range of the mass that the law follows (LqgLaw), over the identified mass
  std::optional<LqgNumbers> like{};      ///< numbers found for a similar device or firmness, from which to start
  std::size_t threads = 0;               ///< 0: one per core
};

/// Law of one axis with its predicted figures.
struct LqgResult {
  LqgNumbers numbers;
  LqgLaws laws;
  LoopFigures figures;             ///< on the identified axis
  double ripple_target = 0;        ///< [N]
  double near_sensitivity = 0;     ///< largest Ms on plants near the identified one
  double far_sensitivity = 0;      ///< largest Ms with other hands
  std::vector<std::string> unmet;  ///< requirements that the search could not meet
};

inline constexpr double kNearSensitivity = 4.5;  ///< bound on Ms on plants near the identified one
inline constexpr double kFarSensitivity = 6;     ///< bound on Ms with other hands

/// The hand that is assumed when none was identified: a relaxed hand.
inline constexpr HandModel kRelaxedHand{.mass = 0.15, .grip_stiffness = 800, .grip_damping = 4};

/// The hands with which the search bounds Ms. These three hands are those of devices/sim/presets.cpp, the relaxed one
/// but for its arm; a test compares them.
inline constexpr HandModel kLooseHand{.mass = 0.05,
                                      .grip_stiffness = 200,
                                      .grip_damping = 2,
                                      .arm_stiffness = 5,
                                      .arm_damping = 1,
                                      .arm_relaxation_s = 0.3};
inline constexpr HandModel kFirmHand{.mass = 0.3,
                                     .grip_stiffness = 2000,
                                     .grip_damping = 10,
                                     .arm_stiffness = 200,
                                     .arm_damping = 5,
                                     .arm_relaxation_s = 2};

/// A law's model of a device that nobody holds. Some hand keeps it stable when someone touches it.
inline constexpr HandModel kHardlyAHand{.mass = 0.02, .grip_stiffness = 200, .grip_damping = 2};

/// A healthy hand's own force.
inline constexpr HandNoise kHealthyHand{.drift = 0.15, .drift_hz = 1, .tremor = 0.04, .tremor_hz = 9};

/// Searches for the law of each axis with a model, independently:
///
///     minimise ln e + 20 [ln(ripple / target)]+ + 5 [ln(Ms_near / 4.5)]+ + 5 [ln(Ms_far / 6)]+
///
/// where e and ripple are those of the identified axis under kHealthyHand and [a]+ = max(a, 0). A law that is unstable
/// on one of the plants costs 30, and 1 for each of them. Near are the identified plant, and the same with the mass of
/// either bound, 0.35 ms later, and with the hand's mass, grip stiffness or grip damping 1.6 times as large or small.
/// Far are a device that nobody holds, also lighter or later, a loose and a firm hand, and the hand as the law sees it
/// where the mass that it follows is smallest and largest: it then weighs as much more or less. The target is a share
/// of options.plain_ripple: 0.43 for quiet, 0.9 for normal and 1.35 for exact. Quantisation is not white on slow axes,
/// which makes the measured ripple 1.1 to 1.2 times as large.
///
/// Starts from nine points, whose weight of the ripple is set so that they meet the target, follows each by
/// minimised(), and then the best. For the axes after the first, and with options.like, one start is what was found
/// before, and two others suffice. The result does not depend on the number of threads. `progress` receives the share
/// that is done, in the calling thread. Returns nothing if `stop` was raised. Takes seconds, and allocates. Throws
/// Error(input) if a model is out of its range.
std::optional<std::array<std::optional<LqgResult>, 3>> search_lqg(
    const std::array<std::optional<AxisModel>, 3>& identified, const LqgSearchOptions& options, const StopRequest& stop,
    const std::function<void(double)>& progress = {});

}  // namespace haptrace
