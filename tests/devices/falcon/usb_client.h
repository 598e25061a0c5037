// Client of an emulated USB bus in another process.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <type_traits>

namespace haptrace::test {

/// Environment variable of child processes with the path of the bus's socket.
inline constexpr const char* kUsbBusSocket = "HAPTRACE_TEST_USB_BUS";

/// A request to usbfs, sent as a message to the bus. Each connection stands for an open file, and its first message
/// carries that file.
struct UsbRequest {
  std::uint64_t request = 0;     ///< ioctl of linux/usbdevice_fs.h
  std::uint64_t urb = 0;         ///< the client's address of the transfer
  std::uint32_t type = 0;        ///< type of the transfer
  std::uint32_t endpoint = 0;    ///< endpoint, or the number of a request that takes only a number
  std::uint32_t timeout_ms = 0;  ///< time-out of a bulk transfer
  std::uint32_t size = 0;        ///< size of the transfer's buffer in `data`
  std::array<std::uint8_t, 1024> data{};
};

struct UsbReply {
  std::int32_t result = 0, error = 0;  ///< result of ioctl() and errno
  std::uint64_t urb = 0;               ///< reaped transfer
  std::int32_t status = 0;             ///< its status
  std::uint32_t size = 0;              ///< its length, or the number of a reply that is only a number
  std::array<std::uint8_t, 1024> data{};
};

/// Sends requests to the bus named in the environment. Threads: any.
class UsbClient {
 public:
  /// Registers an open file with the bus. Returns false if there is no bus, or `fd` is not a file of usbfs.
  bool adopt(int fd);

  /// Answers ioctl(); returns false if the request is not one of usbfs.
  bool handle(int fd, unsigned long request, void* argument, int& result);

  void forget(int fd);

 private:
  [[nodiscard]] int connection(int fd);

  std::mutex mutex_;
  std::map<int, int> connections_;  ///< sockets, by descriptor of the file
};

}  // namespace haptrace::test
