// Emulation of a Novint Falcon: USB chip, boot loader, firmware, mechanism, and the user who homes it.
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

/// Faults of an emulated Falcon, to test how a program handles them. Times count from the start of the emulation [s].
struct FalconFaults {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  struct Outage {
    double at = kNever, lasts = kNever;
    [[nodiscard]] bool covers(double time) const noexcept { return time >= at && time - at < lasts; }
  };

  Outage unplugged;                           ///< the USB cable slips out
  Outage unpowered;                           ///< the power supply is off; firmware and homing are lost
  double stalls = kNever;                     ///< both endpoints stall until the halt of each is cleared
  double hangs = kNever;                      ///< the USB chip stops sending and receiving
  double silent = kNever;                     ///< the firmware stops answering
  double frozen = kNever;                     ///< the encoders stand still while the handle moves
  double lost = 0, garbage = 0, flipped = 0;  ///< probability for each byte of an answer
  int bad_echoes = 0;                         ///< initial firmware loadings with a wrong echo
  int bad_starts = 0;                         ///< initial loadings with right echoes after which nothing runs
  bool slow_chip = false;                     ///< the latency timer stays at 16 ms
  int unhomed = 0;                            ///< leg 1, 2 or 3 never passes its mark; 0: none

  /// Parses NAME[:number[:number]], several of them joined by '+'. Throws Error(input) that begins with `where` and
  /// suggests the nearest name.
  static FalconFaults parse(std::string_view text, const std::string& where);

  /// Returns a one-line description of the text that `parse` accepts.
  static std::string help();
};

/// Emulates how a Falcon responds to bytes and requests, and when. It depends on time stamps only, so any host can
/// drive it, on any clock that does not go back.
///
/// It follows known facts strictly (libnifalcon's, see docs/devices/falcon.md): requests, baud rates, and the sequence
/// that wakes the boot loader. Bytes at another baud rate than the device expects are lost. The rest are assumptions,
/// because facts are missing: the latency timer counts from the last packet that the host took, as in FTDI's
/// application note AN232B-04; DTR going high restarts the boot loader; the motors keep their counts until the next
/// packet, a restart, or removal of the cable, which the firmware survives on its own power supply.
///
/// The encoders measure the legs that hold the plant's handle [counts], from an arbitrary start until a leg is homed.
/// If the plant leaves the legs' reach, the handle stays behind at stops slightly inside it. Motor counts are saturated
/// and become torques; the inverse transpose of the true Jacobian makes these a force on the plant. While homing is
/// requested and a leg is not homed, a simulated user takes the handle, pulls it out beyond every mark, pushes it in,
/// and returns it to its starting place. This movement adds to that of the plant.
///
/// Threads: one at a time. Not real-time.
class EmulatedFalcon {
 public:
  enum class Start : std::uint8_t { switched_on, loaded, homed };

  /// Result of a USB transfer. Nothing happened unless it is `ok`.
  enum class [[nodiscard]] Handshake : std::uint8_t{ok, later, stalled, gone};

  static constexpr std::size_t kPacket = 64;  ///< longest USB packet [bytes]
  static constexpr std::size_t kStatus = 2;   ///< bytes of the chip's status in every packet to the host

  EmulatedFalcon(const FalconCalibration& calibration, LivePlant plant, Start start, const FalconFaults& faults = {},
                 std::uint64_t seed = 1);
  ~EmulatedFalcon();

  /// Takes a vendor request without data; stalls requests that the chip does not know.
  Handshake control(std::uint8_t request, std::uint16_t value, std::int64_t now_ns);

  /// Takes a packet from the host.
  Handshake out(std::span<const std::uint8_t> bytes, std::int64_t now_ns);

  /// Writes the next packet for the host to the first `size` bytes of `packet`. Returns `later` if there is none yet.
  Handshake in(std::array<std::uint8_t, kPacket>& packet, std::size_t& size, std::int64_t now_ns);

  /// Returns when to call in() again [ns]: no packet comes before.
  [[nodiscard]] std::int64_t next_in() const noexcept;

  /// Clears the halt of the endpoint of in() or out().
  void clear_halt(bool of_in) noexcept { (of_in ? in_halted_ : out_halted_) = false; }

  /// Pulls the cable out, by hand; plug_in() puts it back.
  void unplug(std::int64_t now_ns);
  void plug_in(std::int64_t now_ns);

  /// Sets the grip's buttons that are down from now on (FalconReport::Button).
  void press(std::uint8_t buttons) noexcept;

  /// Replaces the faults from now on. Times in the past are not made up for.
  void set_faults(const FalconFaults& faults) noexcept { faults_ = faults; }

  /// Advances to `now_ns` without a transfer.
  void advance_to(std::int64_t now_ns);

  // Internal state as of the last call, which no host can see.
  [[nodiscard]] bool is_there() const noexcept { return !pulled_ && !slipped_; }  ///< whether it is on the bus
  [[nodiscard]] bool runs() const noexcept;                                       ///< whether firmware runs
  [[nodiscard]] bool is_homed() const noexcept;
  [[nodiscard]] int loadings() const noexcept;           ///< number of firmware loadings begun
  [[nodiscard]] std::uint64_t packets() const noexcept;  ///< number of packets that the firmware took
  [[nodiscard]] std::array<std::int16_t, 3> motors() const noexcept;
  [[nodiscard]] std::uint8_t flags() const noexcept;  ///< flags of the last packet: lights, homing
  [[nodiscard]] Vec3 force() const noexcept;          ///< force of the motors on the hand, in W [N]
  [[nodiscard]] Vec3 position() const noexcept;       ///< handle position in W [m]

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

/// Opens a link to an emulated Falcon in this process, without USB, on the monotonic clock. Takes the plant's options
/// (default preset: falcon), `seed` and `fault` from `device`. The firmware already runs, unless a fault concerns its
/// loading. The device is not homed.
///
/// A Falcon with a fault that unplugs it or switches it off lasts: when the same text is opened again, it is the same
/// device, with its firmware and handle as they were. Any other Falcon is new each time.
///
/// Throws Error(input) if an option is invalid, Error(device) if the cable is out or a lasting Falcon is open already.
std::unique_ptr<FalconLink> open_emulated_falcon_link(const DeviceSpec& device, const FalconCalibration& calibration);

}  // namespace haptrace
