#include "tests/devices/falcon/usb_bus.h"

#include "devices/loop/clock.h"
#include "tests/devices/falcon/usb_client.h"
#include "tests/devices/falcon/usb_server.h"

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdarg>
#include <dlfcn.h>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <linux/ioctl.h>
#include <linux/kcmp.h>
#include <linux/usbdevice_fs.h>
#include <span>
#include <spawn.h>
#include <stdexcept>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <umockdev.h>
#include <unistd.h>

namespace haptrace::test {
namespace {

constexpr std::uint8_t kIn = 0x81, kOut = 0x02, kVendorOut = 0x40;
constexpr const char* kDevice = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-1";
constexpr std::size_t kSetup = 8;  // bytes before a control transfer's data
// Full speed, 0403:cb48, one interface with bulk IN 0x81 and bulk OUT 0x02, 64 bytes each.
constexpr const char* kDescriptors =
    "120100020000000803"
    "0448cb000401020301"
    "09022000010100802d"
    "0904000002ffffff02"
    "07058102400000"
    "07050202400000";

std::atomic<UsbBus*> the_bus{nullptr};

int real_close(int fd) {
  static const auto function = reinterpret_cast<int (*)(int)>(dlsym(RTLD_NEXT, "close"));
  return function(fd);
}

/// Returns the client of a process that a test started.
UsbClient& bus_of_parent() {
  static auto* const client = new UsbClient;  // never destroyed: files are closed after all destructors
  return *client;
}

int fails(int error) {
  errno = error;
  return -1;
}

int error_of(EmulatedFalcon::Handshake handshake) {
  using Handshake = EmulatedFalcon::Handshake;
  return handshake == Handshake::gone ? -ESHUTDOWN : handshake == Handshake::stalled ? -EPIPE : 0;
}

}  // namespace

UsbBus::UsbBus() : testbed_(umockdev_testbed_new()) {
  if (umockdev_in_mock_environment() == 0)
    throw std::runtime_error("the preloaded library of umockdev is not there: run it under umockdev-wrapper");
  char* root = umockdev_testbed_get_root_dir(testbed_);
  root_ = root;
  g_free(root);
  std::filesystem::create_directories(root_ + "/dev/bus/usb/001");
  std::filesystem::create_directories(root_ + "/sys/bus/usb/devices");
  the_bus = this;
  server_ = std::make_unique<UsbServer>(*this, root_ + "/usb");
  setenv(kUsbBusSocket, server_->path().c_str(), 1);
  thread_ = std::thread([this] { run(); });
}

UsbBus::~UsbBus() {
  server_.reset();
  unplug();
  {
    const std::scoped_lock lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  thread_.join();
  the_bus = nullptr;
  g_object_unref(testbed_);
}

UsbBus& UsbBus::instance() {
  return *the_bus;
}

std::int64_t UsbBus::now() {
  return monotonic_ns();
}

void UsbBus::plug_in(std::unique_ptr<EmulatedFalcon> falcon, const std::string& serial) {
  bool unseen = false;  // such a device is reused: umockdev ends the program after about fifty devices
  {
    const std::scoped_lock lock(mutex_);
    unseen = fifo_ >= 0 && handles_.empty() && serial == serial_;
  }
  if (!unseen) unplug();
  {
    const std::scoped_lock lock(mutex_);
    falcon_ = std::move(falcon);
    falcon_->advance_to(now());
    serial_ = serial;
    heard_from_guardians_.clear();
    signal();
  }
  if (!unseen) appear();
}

void UsbBus::plug_in_again() {
  falcon([](EmulatedFalcon& falcon) { falcon.plug_in(now()); });
  appear();
}

void UsbBus::appear() {
  ++address_;
  node_ = fmt::format("{}/dev/bus/usb/001/{:03}", root_, address_);
  if (mkfifo(node_.c_str(), 0666) != 0) throw std::runtime_error("no FIFO at " + node_);
  {
    const std::scoped_lock lock(mutex_);
    fifo_ = open(node_.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    fcntl(fifo_, F_SETPIPE_SZ, 4096);
    struct stat status {};
    fstat(fifo_, &status);
    node_number_ = status.st_ino;
    signalled_ = true;
    signal();
  }
  const std::string text = fmt::format(
      "P: /devices/pci0000:00/0000:00:14.0/usb1/1-1\n"
      "E: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: DEVNAME=/dev/bus/usb/001/{0:03}\nE: BUSNUM=001\nE: DEVNUM={0:03}\n"
      "A: busnum=1\\n\nA: devnum={0}\\n\nA: speed=12\\n\nA: bConfigurationValue=1\\n\nA: idVendor=0403\\n\n"
      "A: idProduct=cb48\\n\nA: serial={1}\\n\nH: descriptors={2}\n",
      address_, serial_, kDescriptors);
  GError* error = nullptr;
  if (umockdev_testbed_add_from_string(testbed_, text.c_str(), &error) == 0)
    throw std::runtime_error(error != nullptr ? error->message : "umockdev takes no device");
  umockdev_testbed_uevent(testbed_, kDevice, "add");
}

void UsbBus::unplug() {
  {
    const std::scoped_lock lock(mutex_);
    if (fifo_ < 0) return;
    falcon_->unplug(now());
    for (auto& [fd, handle] : handles_) handle->is_there = false;
    serve();
    node_number_ = 0;
  }
  umockdev_testbed_uevent(testbed_, kDevice, "remove");
  umockdev_testbed_remove_device(testbed_, kDevice);
  std::filesystem::remove(node_);
  const std::scoped_lock lock(mutex_);
  real_close(fifo_);
  fifo_ = -1;
}

std::size_t UsbBus::open_handles() {
  const std::scoped_lock lock(mutex_);
  return handles_.size();
}

std::vector<std::uint8_t> UsbBus::heard_from_guardians() {
  const std::scoped_lock lock(mutex_);
  return heard_from_guardians_;
}

/// Returns the handle of an open file, for any of its descriptors.
std::shared_ptr<UsbBus::Handle> UsbBus::find(int fd) {
  const auto known = handles_.find(fd);
  if (known != handles_.end()) return known->second;
  // ThreadSanitizer sees fstat, but not every close: to it, a number that was used before is another thread's file.
  struct stat status {};
  if (node_number_ == 0 || fstatat(fd, "", &status, AT_EMPTY_PATH) != 0 || status.st_ino != node_number_ ||
      fd >= kMostFiles)
    return nullptr;
  known_[fd] = true;
  for (const auto& [other, handle] : handles_)
    if (syscall(SYS_kcmp, getpid(), getpid(), KCMP_FILE, fd, other) == 0) return handles_[fd] = handle;
  return handles_[fd] = std::make_shared<Handle>();
}

bool UsbBus::handle(int fd, unsigned long request, void* argument, int& result) {
  if (_IOC_TYPE(request) != 'U') return false;
  std::unique_lock lock(mutex_);
  const std::shared_ptr<Handle> handle = find(fd);
  if (handle == nullptr) return false;
  if (request == USBDEVFS_REAPURBNDELAY) {
    result = reap(*handle, static_cast<usbdevfs_urb**>(argument));
    return true;
  }
  if (!handle->is_there) {
    result = fails(ENODEV);
    return true;
  }
  result = 0;
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
      *static_cast<std::uint32_t*>(argument) = USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
      break;
    case USBDEVFS_CLAIMINTERFACE:
      result = claim(*handle);
      break;
    case USBDEVFS_RELEASEINTERFACE:
      handle->claims = false;
      break;
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_RESET:
      break;
    case USBDEVFS_GETDRIVER:
      result = fails(ENODATA);
      break;
    case USBDEVFS_CLEAR_HALT:
      falcon_->clear_halt(*static_cast<unsigned*>(argument) == kIn);
      break;
    case USBDEVFS_SUBMITURB:
      result = submit(*handle, static_cast<usbdevfs_urb*>(argument));
      break;
    case USBDEVFS_DISCARDURB:
      result = discard(static_cast<usbdevfs_urb*>(argument));
      break;
    case USBDEVFS_BULK:
      result = send(*handle, *static_cast<usbdevfs_bulktransfer*>(argument), lock);
      break;
    default:
      result = fails(ENOTTY);
  }
  return true;
}

int UsbBus::claim(Handle& handle) {
  for (const auto& [fd, other] : handles_)
    if (other.get() != &handle && other->claims) return fails(EBUSY);
  handle.claims = true;
  return 0;
}

/// Copies the data to the device now; reap() writes the data from the device.
int UsbBus::submit(const Handle& handle, usbdevfs_urb* urb) {
  const bool is_control = urb->type == USBDEVFS_URB_TYPE_CONTROL;
  if (!is_control && (urb->type != USBDEVFS_URB_TYPE_BULK || (urb->endpoint != kIn && urb->endpoint != kOut)))
    return fails(EINVAL);
  Transfer transfer{.handle = &handle, .urb = urb, .data = {}};
  if (is_control || urb->endpoint == kOut) {
    const auto* bytes = static_cast<const std::uint8_t*>(urb->buffer);
    transfer.data.assign(bytes, bytes + urb->buffer_length);
  }
  pending_.push_back(std::move(transfer));
  serve();
  wake_.notify_all();
  return 0;
}

int UsbBus::discard(usbdevfs_urb* urb) {
  for (auto transfer = pending_.begin(); transfer != pending_.end(); ++transfer) {
    if (transfer->urb != urb) continue;
    Transfer discarded = std::move(*transfer);
    pending_.erase(transfer);
    discarded.status = -ENOENT;
    end(std::move(discarded));
    return 0;
  }
  return fails(EINVAL);
}

int UsbBus::reap(const Handle& handle, usbdevfs_urb** urb) {
  for (auto transfer = ended_.begin(); transfer != ended_.end(); ++transfer) {
    if (transfer->handle != &handle) continue;
    usbdevfs_urb& ended = *transfer->urb;
    ended.status = transfer->status;
    ended.actual_length = static_cast<int>(transfer->data.size());
    if (ended.type == USBDEVFS_URB_TYPE_BULK && ended.endpoint == kIn)
      std::copy(transfer->data.begin(), transfer->data.end(), static_cast<std::uint8_t*>(ended.buffer));
    *urb = &ended;
    ended_.erase(transfer);
    signal();
    return 0;
  }
  return fails(handle.is_there ? EAGAIN : ENODEV);
}

/// Claims the interface if it is free, like usbfs.
int UsbBus::send(Handle& handle, const usbdevfs_bulktransfer& transfer, std::unique_lock<std::mutex>& lock) {
  if (transfer.ep != kOut) return fails(EINVAL);
  if (!handle.claims && claim(handle) != 0) return -1;
  const auto* data = static_cast<const std::uint8_t*>(transfer.data);
  const std::span bytes(data, transfer.len);
  const std::int64_t end = now() + 1'000'000LL * transfer.timeout;
  const auto waits_before = [](const Transfer& other) { return other.urb->endpoint == kOut; };
  while (true) {
    serve();
    auto handshake = EmulatedFalcon::Handshake::later;
    if (std::none_of(pending_.begin(), pending_.end(), waits_before)) handshake = falcon_->out(bytes, now());
    if (const int error = error_of(handshake); error != 0) return fails(-error);
    if (handshake == EmulatedFalcon::Handshake::ok) break;
    if (now() >= end) return fails(ETIMEDOUT);
    wake_.wait_for(lock, std::chrono::milliseconds(1));
  }
  heard_from_guardians_.insert(heard_from_guardians_.end(), bytes.begin(), bytes.end());
  return static_cast<int>(transfer.len);
}

/// Returns whether the transfer has ended.
bool UsbBus::progress(Transfer& transfer) {
  using Handshake = EmulatedFalcon::Handshake;
  const usbdevfs_urb& urb = *transfer.urb;
  if (urb.type == USBDEVFS_URB_TYPE_BULK && urb.endpoint == kIn) return receive(transfer);
  Handshake handshake = Handshake::stalled;
  if (urb.type == USBDEVFS_URB_TYPE_BULK) {
    handshake = falcon_->out(transfer.data, now());
  } else if (transfer.data.size() >= kSetup && transfer.data[0] == kVendorOut) {
    const auto value = static_cast<std::uint16_t>(transfer.data[2] | transfer.data[3] << 8);
    handshake = falcon_->control(transfer.data[1], value, now());
  }
  if (handshake == Handshake::later) return false;
  transfer.status = error_of(handshake);
  if (urb.type == USBDEVFS_URB_TYPE_CONTROL || handshake != Handshake::ok) transfer.data.clear();
  return true;
}

/// Reads packets until one is short or the buffer is full; returns whether the transfer has ended.
bool UsbBus::receive(Transfer& transfer) {
  using Handshake = EmulatedFalcon::Handshake;
  std::array<std::uint8_t, EmulatedFalcon::kPacket> packet{};
  const auto room = static_cast<std::size_t>(transfer.urb->buffer_length);
  while (true) {
    std::size_t size = 0;
    const Handshake handshake = falcon_->in(packet, size, now());
    if (handshake == Handshake::later) return false;
    if (handshake != Handshake::ok) {
      transfer.status = error_of(handshake);
      return true;
    }
    const std::size_t count = std::min(size, room - transfer.data.size());
    transfer.data.insert(transfer.data.end(), packet.begin(), packet.begin() + static_cast<std::ptrdiff_t>(count));
    if (count < size) transfer.status = -EOVERFLOW;
    if (size < packet.size() || transfer.data.size() == room) return true;
  }
}

/// Ends transfers that are done. Those of one endpoint end in the order of their submission.
void UsbBus::serve() {
  bool waits[256]{};
  for (auto transfer = pending_.begin(); transfer != pending_.end();) {
    bool& waiting = waits[transfer->urb->endpoint];
    if (waiting || !progress(*transfer)) {
      waiting = true;
      ++transfer;
      continue;
    }
    Transfer ended = std::move(*transfer);
    transfer = pending_.erase(transfer);
    end(std::move(ended));
  }
}

void UsbBus::end(Transfer transfer) {
  ended_.push_back(std::move(transfer));
  signal();
}

/// Makes the node writable when there is a transfer to reap or the device is gone.
void UsbBus::signal() {
  if (fifo_ < 0) return;
  const bool wanted = !ended_.empty() || !falcon_->is_there();
  if (wanted == signalled_) return;
  signalled_ = wanted;
  char byte = 0;
  [[maybe_unused]] const ssize_t done = wanted ? read(fifo_, &byte, 1) : write(fifo_, &byte, 1);
}

void UsbBus::forget(int fd) {
  const std::scoped_lock lock(mutex_);
  known_[fd] = false;
  const auto known = handles_.find(fd);
  if (known == handles_.end()) return;
  const std::shared_ptr<Handle> handle = known->second;
  handles_.erase(known);
  if (std::any_of(handles_.begin(), handles_.end(), [&](const auto& other) { return other.second == handle; })) return;
  const auto is_of = [&](const Transfer& transfer) { return transfer.handle == handle.get(); };
  std::erase_if(pending_, is_of);
  std::erase_if(ended_, is_of);
  signal();
}

void UsbBus::run() {
  prctl(PR_SET_TIMERSLACK, 1);
  std::unique_lock lock(mutex_);
  while (!ending_) {
    if (pending_.empty()) {
      wake_.wait(lock);
      continue;
    }
    const std::int64_t next = std::min(falcon_->next_in(), now() + 1'000'000);
    wake_.wait_until(lock, std::chrono::steady_clock::time_point(std::chrono::nanoseconds(next)));
    if (falcon_) serve();
  }
}

}  // namespace haptrace::test

extern "C" {

int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  int result = 0;
  haptrace::test::UsbBus* bus = haptrace::test::the_bus;
  if (bus != nullptr ? bus->handle(fd, request, argument, result)
                     : haptrace::test::bus_of_parent().handle(fd, request, argument, result))
    return result;
  static const auto next = reinterpret_cast<int (*)(int, unsigned long, void*)>(dlsym(RTLD_NEXT, "ioctl"));
  return next(fd, request, argument);
}

int close(int fd) {
  haptrace::test::UsbBus* bus = haptrace::test::the_bus;
  if (bus == nullptr)
    haptrace::test::bus_of_parent().forget(fd);
  else if (bus->knows(fd))
    bus->forget(fd);
  return haptrace::test::real_close(fd);
}

/// Gives guardians access to the bus. A process without an environment is a guardian.
int posix_spawn(pid_t* child, const char* path, const posix_spawn_file_actions_t* files,
                const posix_spawnattr_t* attributes, char* const arguments[], char* const environment[]) {
  static const auto next = reinterpret_cast<decltype(&posix_spawn)>(dlsym(RTLD_NEXT, "posix_spawn"));
  const char* socket = std::getenv(haptrace::test::kUsbBusSocket);
  if (environment[0] != nullptr || socket == nullptr)
    return next(child, path, files, attributes, arguments, environment);
  std::string preload = "LD_PRELOAD=" USB_PRELOAD, bus = fmt::format("{}={}", haptrace::test::kUsbBusSocket, socket);
  char* const given[] = {preload.data(), bus.data(), nullptr};
  return next(child, path, files, attributes, arguments, given);
}
}
