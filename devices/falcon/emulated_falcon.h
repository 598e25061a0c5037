// A Novint Falcon without the hardware: its USB chip, boot loader, firmware and mechanism, and whoever homes it.
#pragma once

#include "devices/device_spec.h"
#include "devices/falcon/calibration.h"
#include "devices/falcon/link.h"
#include "devices/sim/live_plant.h"

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

/// What goes wrong with an emulated Falcon, to try out what a program does about it. Times count from its making [s].
struct FalconFaults {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  struct Outage {
    double at = kNever, lasts = kNever;
    [[nodiscard]] bool covers(double time) const noexcept { return time >= at && time - at < lasts; }
  };

  Outage unplugged;                           ///< the USB cable slips out
  Outage unpowered;                           ///< the supply is off, and firmware and homing are forgotten
  double stalls = kNever;                     ///< both endpoints stall, until the halt of each is cleared
  double hangs = kNever;                      ///< the USB chip takes and gives nothing any more
  double silent = kNever;                     ///< the firmware answers no more
  double frozen = kNever;                     ///< encoders stand still while the handle moves
  double lost = 0, garbage = 0, flipped = 0;  ///< chance, for each byte that the firmware answers
  int bad_echoes = 0;                         ///< so many firmware loadings have a wrong echo
  int bad_starts = 0;                         ///< after so many loadings, echoes right, nothing runs
  bool slow_chip = false;                     ///< the latency timer stays at 16 ms
  int unhomed = 0;                            ///< leg 1, 2 or 3 never passes its mark

  /// Reads NAME[:number[:number]], several of them joined by '+'. Throws Error(input) that begins with `where` and
  /// names the nearest.
  static FalconFaults parse(std::string_view text, const std::string& where);

  /// What `parse` understands, in a line.
  static std::string help();
};

/// What the device makes of bytes and requests, and when: a function of time stamps alone, so that any host can drive
/// it, on any clock that does not go back.
///
/// Known facts (libnifalcon's, see docs/devices/falcon.md) are kept to strictly: requests, speeds and the order in
/// which a boot loader is woken; bytes sent at another speed than the device listens at are lost. Assumed, for want of
/// facts: the latency timer counts from the packet that the host took last, as FTDI's application note AN232B-04 has
/// it; DTR going high restarts the boot loader; counts stay in the motors until the next packet, a restart, or the
/// cable being out, which the firmware outlives on its own supply.
///
/// The encoders are those of the legs that hold the plant's handle, in counts, from an arbitrary start until a leg is
/// homed. Where the plant is out of the legs' reach, the handle stays behind, at stops a little inside. Motor counts
/// become torques, saturated, and by the transposed inverse of the true Jacobian a force on the plant. While homing is
/// asked for and a leg is not homed, a user takes the handle, pulls it out beyond every mark, pushes it in and returns
/// it to where he took it; this movement adds to that of the plant.
///
/// Threads: one at a time. Not real-time.
class EmulatedFalcon {
 public:
  enum class Start : std::uint8_t { switched_on, loaded, homed };

  /// Of USB. Nothing happened unless it is `ok`.
  enum class [[nodiscard]] Handshake : std::uint8_t{ok, later, stalled, gone};

  static constexpr std::size_t kPacket = 64;  ///< the longest USB packet
  static constexpr std::size_t kStatus = 2;   ///< of its bytes are the chip's own, in every packet to the host

  EmulatedFalcon(const FalconCalibration& calibration, LivePlant plant, Start start, const FalconFaults& faults = {},
                 std::uint64_t seed = 1);
  ~EmulatedFalcon();

  /// A vendor request that takes no data; those that the chip does not know are stalled.
  Handshake control(std::uint8_t request, std::uint16_t value, std::int64_t now_ns);

  /// A packet from the host.
  Handshake out(std::span<const std::uint8_t> bytes, std::int64_t now_ns);

  /// The next packet for the host, in the first `size` bytes of `packet`; `later` when there is none yet.
  Handshake in(std::array<std::uint8_t, kPacket>& packet, std::size_t& size, std::int64_t now_ns);

  /// When it is worth to ask `in` again [ns]: no packet is there before.
  [[nodiscard]] std::int64_t next_in() const noexcept;

  /// Of the endpoint of `in`, or that of `out`.
  void clear_halt(bool of_in) noexcept { (of_in ? in_halted_ : out_halted_) = false; }

  /// The cable, by hand.
  void unplug(std::int64_t now_ns);
  void plug_in(std::int64_t now_ns);

  /// The grip's buttons that are down from now on, FalconReport::Button.
  void press(std::uint8_t buttons) noexcept;

  /// Whatever goes wrong from now on; what it says about the past is not made up for.
  void set_faults(const FalconFaults& faults) noexcept { faults_ = faults; }

  /// Lets time pass that no transfer shows.
  void advance_to(std::int64_t now_ns);

  // What nobody sees from outside, as of the last call.
  [[nodiscard]] bool is_there() const noexcept { return !pulled_ && !slipped_; }  ///< on the bus
  [[nodiscard]] bool runs() const noexcept;                                       ///< firmware
  [[nodiscard]] bool is_homed() const noexcept;
  [[nodiscard]] int loadings() const noexcept;           ///< begun
  [[nodiscard]] std::uint64_t packets() const noexcept;  ///< that the firmware took
  [[nodiscard]] std::array<std::int16_t, 3> motors() const noexcept;
  [[nodiscard]] std::uint8_t flags() const noexcept;  ///< of the last packet: lights, homing
  [[nodiscard]] Vec3 force() const noexcept;          ///< of the motors on the hand, in W [N]
  [[nodiscard]] Vec3 position() const noexcept;       ///< of the handle, in W [m]

 private:
  class Mechanism;
  class Board;
  class Line;

  [[nodiscard]] double age() const noexcept { return 1e-9 * static_cast<double>(now_ns_ - begin_ns_); }
  Handshake endpoint(bool& halted, std::int64_t now_ns);
  void live_until(std::int64_t now_ns);
  void set_baud(std::uint16_t divisor) noexcept;
  void set_modem(std::uint16_t lines) noexcept;
  void reset_chip() noexcept;

  FalconFaults faults_;
  std::unique_ptr<Mechanism> mechanism_;
  std::unique_ptr<Board> board_;
  std::unique_ptr<Line> from_host_, to_host_;

  std::int64_t begin_ns_ = -1, now_ns_ = -1;
  std::int64_t latency_ns_ = 0, last_in_ns_ = 0;
  double baud_ = 0;
  bool eight_bits_ = true;
  bool pulled_ = false, slipped_ = false;  ///< the cable is out, by hand or by a fault
  bool in_halted_ = false, out_halted_ = false, has_stalled_ = false;
};

/// A link to an emulated Falcon in this process, without USB, on the monotonic clock. Of `device` it takes the options
/// of the plant (preset falcon unless they say otherwise), `seed`, and `fault`. Its firmware runs already, unless a
/// fault is about loading it; nobody has homed it.
///
/// What is unplugged or switched off by a fault is the same device when it is opened again with the same text, with
/// its firmware and its handle where they were. Any other is a new one each time.
///
/// Throws Error(input) when an option is wrong, Error(device) while its cable is out.
std::unique_ptr<FalconLink> open_emulated_falcon_link(const DeviceSpec& device, const FalconCalibration& calibration);

}  // namespace haptrace
