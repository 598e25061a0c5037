// A process that stops a device's motors when its host no longer can.
#pragma once

#include <cstdint>
#include <string>
#include <sys/types.h>
#include <vector>

namespace haptrace {

/// Port by which a guardian reaches its device.
struct GuardedPort {
  /// Descriptor of a serial port, or of a usbfs file (/dev/bus/usb) on which the interface is claimed. The claim
  /// belongs to the open file, so it outlives the host in a guardian that has inherited the file.
  int descriptor = -1;
  std::uint8_t endpoint = 0;  ///< endpoint for bulk transfers to a USB device; 0: a serial port
};

/// Bytes that the guardian sends to the device in place of the host. Both remove the force, wherever the host's last
/// bytes broke off. At most 65535 bytes each.
struct LastWords {
  std::vector<std::uint8_t> when_silent;  ///< the host shows no sign of life: stopped or starved, it may come back
  std::vector<std::uint8_t> when_dead;    ///< the host is gone
};

/// Messages over the socket between a host and its guardian, after the words: one byte each.
inline constexpr char kGuardianReady = 'r';   ///< the guardian watches
inline constexpr char kGuardianBeat = '.';    ///< the host is alive
inline constexpr char kGuardianSpeak = 's';   ///< send the words at once; answered by one of the next two
inline constexpr char kGuardianSpoke = 'y';   ///< the port took the words
inline constexpr char kGuardianFailed = 'n';  ///< the port did not take the words
inline constexpr char kGuardianGo = 'q';      ///< end without sending any words

/// A separate process for devices that keep their last force for ever. It also holds the port. Killing the host does
/// not kill the guardian, nor does Ctrl+C or a closed terminal. Anything that kills every process of a machine, a
/// container or a service kills it as well.
///
/// Threads: one at a time, except for speak(). Not real-time.
class Guardian {
 public:
  static constexpr double kPatience = 0.1;        ///< time without a beat after which a host is silent [s]
  static constexpr double kHeartbeat = 0.02;      ///< longest time that a caller should leave between two beats [s]
  static constexpr double kLongestSpeech = 0.15;  ///< longest duration of speak() [s]

  /// Starts the guardian and returns once it watches. Throws Error(device) if its program cannot be run.
  Guardian(const GuardedPort& port, const LastWords& words);
  ~Guardian();
  Guardian(const Guardian&) = delete;
  Guardian& operator=(const Guardian&) = delete;

  /// Reports that the host is alive. Throws Error(device) if the guardian is not, because nothing would stop the
  /// motors.
  void beat();

  /// Lets the guardian remove the force now, as for a silent host. Returns whether the port took the words; false after
  /// kLongestSpeech. Call it at most once, from any thread, even while another thread is in beat(), dismiss() or
  /// speak_and_go().
  [[nodiscard]] bool speak() noexcept;

  /// Ends the guardian, which sends no words. Idempotent, like speak_and_go().
  void dismiss() noexcept;

  /// Ends the guardian, which first sends its words for a dead host. Returns whether the port took them.
  [[nodiscard]] bool speak_and_go() noexcept;

  [[nodiscard]] pid_t process() const noexcept { return process_; }

 private:
  [[nodiscard]] bool leave() noexcept;

  int line_ = -1;  ///< socket to its standard input; open until the destructor, because speak() may use it at any time
  pid_t process_ = -1;
  bool left_ = false;
  std::int64_t beaten_ns_ = 0;
};

/// Returns the places where a program at `self` looks for the guardian's program, in this order: beside it, if both are
/// installed; where it was built, only for a program of the same build folder; where it was installed. An installed
/// program never looks in a build folder, which may belong to another user by now.
std::vector<std::string> guardian_places(const std::string& self);

/// Returns the first of guardian_places() for this program that can be run; empty if none can.
std::string guardian_program();

}  // namespace haptrace
