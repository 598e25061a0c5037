// Stops the motors of a device whose host no longer can.
#pragma once

#include <cstdint>
#include <string>
#include <sys/types.h>
#include <vector>

namespace haptrace {

/// Where a guardian reaches its device.
struct GuardedPort {
  /// A serial port, or a file of usbfs (/dev/bus/usb) on which the interface is claimed. The claim belongs to the open
  /// file, so it outlives the host in a guardian that has inherited the file.
  int descriptor = -1;
  std::uint8_t endpoint = 0;  ///< for bulk transfers to a USB device; 0: a serial port
};

/// What is sent to a device in the host's place. Either takes the force away, wherever the host's last bytes broke off.
/// At most 65535 bytes each.
struct LastWords {
  std::vector<std::uint8_t> when_silent;  ///< the host shows no life: it is stopped, or starved. It may come back
  std::vector<std::uint8_t> when_dead;    ///< the host is gone
};

/// What goes over the socket between a host and its guardian, after the words: a byte each.
inline constexpr char kGuardianReady = 'r';   ///< the guardian watches
inline constexpr char kGuardianBeat = '.';    ///< the host lives
inline constexpr char kGuardianSpeak = 's';   ///< speak at once; answered by one of the next two
inline constexpr char kGuardianSpoke = 'y';   ///< the port took the words
inline constexpr char kGuardianFailed = 'n';  ///< it did not
inline constexpr char kGuardianGo = 'q';      ///< go without a word

/// A process of its own, for devices that keep their last force for ever. It holds the port too; killing the host does
/// not kill it, nor does Ctrl+C or a closed terminal. What kills every process of a machine, a container or a service
/// kills it as well.
///
/// Threads: one at a time, but for speak(). Not real-time.
class Guardian {
 public:
  static constexpr double kPatience = 0.1;        ///< after which a host is silent [s]
  static constexpr double kHeartbeat = 0.02;      ///< the longest a caller should leave between two beats [s]
  static constexpr double kLongestSpeech = 0.15;  ///< of speak() [s]

  /// Returns once the guardian watches. Throws Error(device) when its program cannot be run.
  Guardian(const GuardedPort& port, const LastWords& words);
  ~Guardian();
  Guardian(const Guardian&) = delete;
  Guardian& operator=(const Guardian&) = delete;

  /// The host lives. Throws Error(device) when the guardian does not: nothing would stop the motors.
  void beat();

  /// Lets the guardian take the force away now, as for a silent host. Returns whether the port took the words; false
  /// after kLongestSpeech. For any thread, also while another beats or is in one of the next two, but once.
  [[nodiscard]] bool speak() noexcept;

  /// It is no longer needed: it goes without a word. Idempotent, as is the next.
  void dismiss() noexcept;

  /// It says its last words and goes. Returns whether the port took the words.
  [[nodiscard]] bool speak_and_go() noexcept;

  [[nodiscard]] pid_t process() const noexcept { return process_; }

 private:
  [[nodiscard]] bool leave() noexcept;

  int line_ = -1;  ///< to its standard input, until the destructor: speak() may use it at any time
  pid_t process_ = -1;
  bool left_ = false;
  std::int64_t beaten_ns_ = 0;
};

/// Where the guardian's program is looked for by a program at `self`, in this order: beside it when both are installed;
/// where it was built, for a program of the same build folder alone; where it was installed to. An installed program
/// never looks into a build folder: that may be another user's by now.
std::vector<std::string> guardian_places(const std::string& self);

/// The first of guardian_places() for this program at which it can be run; empty when it is at none.
std::string guardian_program();

}  // namespace haptrace
