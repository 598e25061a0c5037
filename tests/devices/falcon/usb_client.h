// The emulated USB bus of another process.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <type_traits>

namespace haptrace::test {

/// Names the bus's socket, in the environment of its children.
inline constexpr const char* kUsbBusSocket = "HAPTRACE_TEST_USB_BUS";

/// A request to usbfs as it goes to the bus: a message of a connection, which stands for an open file. The first
/// message of a connection is that file itself.
struct UsbRequest {
  std::uint64_t request = 0;     ///< an ioctl of linux/usbdevice_fs.h
  std::uint64_t urb = 0;         ///< the transfer, as its owner calls it
  std::uint32_t type = 0;        ///< of the transfer
  std::uint32_t endpoint = 0;    ///< also the number that a request consists of
  std::uint32_t timeout_ms = 0;  ///< 0: for ever
  std::uint32_t size = 0;        ///< of the transfer's memory, which is in `data`
  std::array<std::uint8_t, 1024> data{};
};

struct UsbReply {
  std::int32_t result = 0, error = 0;  ///< of ioctl()
  std::uint64_t urb = 0;               ///< that was reaped
  std::int32_t status = 0;             ///< of it
  std::uint32_t size = 0;              ///< of what it brought; also the number that a reply consists of
  std::array<std::uint8_t, 1024> data{};
};

/// Asks the bus that the environment names. Threads: any.
class UsbClient {
 public:
  /// Shows the bus an open file. False when there is no bus, or it is no file of usbfs.
  bool adopt(int fd);

  /// Answers ioctl(); false when it is none of usbfs.
  bool handle(int fd, unsigned long request, void* argument, int& result);

  void forget(int fd);

 private:
  [[nodiscard]] int connection(int fd);

  std::mutex mutex_;
  std::map<int, int> connections_;  ///< sockets, by the file that each stands for
};

}  // namespace haptrace::test
