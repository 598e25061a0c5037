// A USB port for tests: an unmodified libusb in this process sees an emulated Falcon on it.
#pragma once

#include "devices/falcon/emulated_falcon.h"

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

struct usbdevfs_urb;
struct usbdevfs_bulktransfer;
struct _UMockdevTestbed;

namespace haptrace::test {

class UsbServer;

/// Replaces the kernel's USB. umockdev provides the tree below /sys and the messages of udev; the program has to run
/// under its preloaded library. The functions ioctl() and close() of this program answer for the device's node like the
/// kernel's usbfs (linux/usbdevice_fs.h). The node is a FIFO with room for one byte. While the byte is in it, the node
/// is not writable, which in usbfs means that no transfer has ended.
///
/// Other processes reach the bus through a socket (usb_client.h). If this program starts itself again, its own ioctl()
/// uses the socket; guardians get a library to preload.
///
/// Each test program makes one before any thread starts. Threads: any, except for the constructor.
class UsbBus {
 public:
  UsbBus();
  ~UsbBus();
  UsbBus(const UsbBus&) = delete;
  UsbBus& operator=(const UsbBus&) = delete;

  static UsbBus& instance();

  /// Plugs a Falcon in, in place of the previous one.
  void plug_in(std::unique_ptr<EmulatedFalcon> falcon, const std::string& serial = "F1");

  void unplug();
  void plug_in_again();  ///< plugs the last one in again

  /// Calls `look` under the lock with the current or last Falcon, advanced to now.
  template <class Look>
  auto falcon(Look look) {
    const std::scoped_lock lock(mutex_);
    falcon_->advance_to(now());
    return look(*falcon_);
  }

  [[nodiscard]] std::size_t open_handles();

  /// Returns the bytes written with USBDEVFS_BULK since the last plug_in(); only guardians use it.
  [[nodiscard]] std::vector<std::uint8_t> heard_from_guardians();

  // For ioctl() and close(). handle() returns false if `fd` is not a file of this bus.
  bool handle(int fd, unsigned long request, void* argument, int& result);
  void forget(int fd);

  /// Adds a file of another process.
  void adopt(int fd) {
    const std::scoped_lock lock(mutex_);
    (void)find(fd);
  }

  /// Takes no lock: sanitizers may close files at any time.
  [[nodiscard]] bool knows(int fd) const noexcept { return fd >= 0 && fd < kMostFiles && known_[fd]; }

 private:
  static constexpr int kMostFiles = 4096;

  /// An open file. It may have several descriptors, in several processes.
  struct Handle {
    bool is_there = true;
    bool claims = false;
  };
  struct Transfer {
    const Handle* handle;
    usbdevfs_urb* urb;
    std::vector<std::uint8_t> data;  ///< data to or from the device
    int status = 0;                  ///< 0 or a negative errno
  };

  [[nodiscard]] static std::int64_t now();
  void appear();
  [[nodiscard]] std::shared_ptr<Handle> find(int fd);
  int claim(Handle& handle);
  int submit(const Handle& handle, usbdevfs_urb* urb);
  int discard(usbdevfs_urb* urb);
  int reap(const Handle& handle, usbdevfs_urb** urb);
  int send(Handle& handle, const usbdevfs_bulktransfer& transfer, std::unique_lock<std::mutex>& lock);
  [[nodiscard]] bool progress(Transfer& transfer);
  [[nodiscard]] bool receive(Transfer& transfer);
  void serve();
  void end(Transfer transfer);
  void signal();
  void run();

  _UMockdevTestbed* testbed_;
  std::string root_, node_;  ///< folder of the testbed, path of the FIFO
  std::string serial_;
  int address_ = 1;

  std::mutex mutex_;  ///< guards the members below
  std::unique_ptr<EmulatedFalcon> falcon_;
  int fifo_ = -1;
  std::uint64_t node_number_ = 0;  ///< inode of the FIFO
  bool signalled_ = false;
  std::map<int, std::shared_ptr<Handle>> handles_;
  std::vector<std::uint8_t> heard_from_guardians_;
  std::deque<Transfer> pending_, ended_;
  std::atomic<bool> known_[kMostFiles]{};  ///< the keys of handles_
  bool ending_ = false;
  std::condition_variable wake_;
  std::thread thread_;                 ///< ends transfers in time
  std::unique_ptr<UsbServer> server_;  ///< serves other processes
};

}  // namespace haptrace::test
