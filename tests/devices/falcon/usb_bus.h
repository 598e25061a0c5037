// A USB port of this process, into which an emulated Falcon is plugged, and which an unmodified libusb sees.
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

/// What the kernel would be. The tree below /sys and the messages of udev are umockdev's, under whose preloaded library
/// the program has to run; what is asked of the device's node, the functions ioctl() and close() of this program answer
/// instead of the kernel, as its usbfs does (linux/usbdevice_fs.h). The node is a FIFO that can hold one byte: as long
/// as one is in it, it cannot be written to, which for usbfs says that no transfer has ended.
///
/// Other processes reach it through a socket, as usb_client.h has it; the same program answers their ioctl() when it is
/// run by this one, and guardians are given a library to preload.
///
/// One for each test program, made before any thread. Threads: any, except for the making.
class UsbBus {
 public:
  UsbBus();
  ~UsbBus();
  UsbBus(const UsbBus&) = delete;
  UsbBus& operator=(const UsbBus&) = delete;

  static UsbBus& instance();

  /// Unplugs what is there before.
  void plug_in(std::unique_ptr<EmulatedFalcon> falcon, const std::string& serial = "F1");

  void unplug();
  void plug_in_again();  ///< what was unplugged

  /// Calls `look` with what is or was plugged in, as of now, while nobody else touches it.
  template <class Look>
  auto falcon(Look look) {
    const std::scoped_lock lock(mutex_);
    falcon_->advance_to(now());
    return look(*falcon_);
  }

  [[nodiscard]] std::size_t open_handles();

  /// What came by USBDEVFS_BULK, which only a guardian uses, since the last plug_in().
  [[nodiscard]] std::vector<std::uint8_t> heard_from_guardians();

  // For ioctl() and close(). The first is false when `fd` is not of this bus.
  bool handle(int fd, unsigned long request, void* argument, int& result);
  void forget(int fd);

  /// A file of another process.
  void adopt(int fd) {
    const std::scoped_lock lock(mutex_);
    (void)find(fd);
  }

  /// Without a lock: sanitizers close files in the middle of anything.
  [[nodiscard]] bool knows(int fd) const noexcept { return fd >= 0 && fd < kMostFiles && known_[fd]; }

 private:
  static constexpr int kMostFiles = 4096;

  /// An open file, which may have several descriptors in several processes.
  struct Handle {
    bool is_there = true;
    bool claims = false;
  };
  struct Transfer {
    const Handle* handle;
    usbdevfs_urb* urb;
    std::vector<std::uint8_t> data;  ///< for the host
    int status = 0;                  ///< an errno, negative
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

  std::mutex mutex_;  ///< guards what follows
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
  std::thread thread_;                 ///< ends transfers when it is time
  std::unique_ptr<UsbServer> server_;  ///< for other processes
};

}  // namespace haptrace::test
