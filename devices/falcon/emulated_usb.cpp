// libusb with one emulated Falcon plugged in, for other programs: a library to preload.
//
//     HAPTRACE_FALCON='hand=relaxed' LD_PRELOAD=libhaptrace-falcon-usb.so their_program
//
// It defines the functions of libusb 1.0 that programs for the Falcon call, including libftdi 1.x, in front of an
// EmulatedFalcon on the monotonic clock. HAPTRACE_FALCON holds the options of `falcon:emulated=true`, and
// `start=switched_on | loaded | homed`. See docs/devices/falcon-for-other-programs.md.
//
// Threads: any, as in libusb. Callbacks run in the thread that handles events, without a lock.

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/falcon/emulated_falcon.h"
#include "devices/loop/clock.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fmt/format.h>
#include <libusb.h>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

struct libusb_context {};
struct libusb_device {};
struct libusb_device_handle {};

namespace haptrace {
namespace {

using Handshake = EmulatedFalcon::Handshake;

constexpr std::uint16_t kVendor = 0x0403, kProduct = 0xcb48;
constexpr std::uint8_t kBulkIn = 0x81, kBulkOut = 0x02;
constexpr std::uint8_t kVendorOut = 0x40, kStandardIn = 0x80;
constexpr int kBusNumber = 1, kAddress = 2;
constexpr std::int64_t kLongestNap = 1'000'000;  // longest pause between two polls of the device [ns]
constexpr std::array kTexts{"", "FTDI", "FALCON HAPTIC", "EMULATED"};

libusb_context the_context;
libusb_device the_device;

int result_of(Handshake handshake) {
  switch (handshake) {
    case Handshake::ok:
      return LIBUSB_SUCCESS;
    case Handshake::stalled:
      return LIBUSB_ERROR_PIPE;
    case Handshake::gone:
      return LIBUSB_ERROR_NO_DEVICE;
    case Handshake::later:
      break;
  }
  return LIBUSB_ERROR_TIMEOUT;
}

libusb_transfer_status status_of(int result) {
  switch (result) {
    case LIBUSB_SUCCESS:
      return LIBUSB_TRANSFER_COMPLETED;
    case LIBUSB_ERROR_PIPE:
      return LIBUSB_TRANSFER_STALL;
    case LIBUSB_ERROR_NO_DEVICE:
      return LIBUSB_TRANSFER_NO_DEVICE;
    case LIBUSB_ERROR_TIMEOUT:
      return LIBUSB_TRANSFER_TIMED_OUT;
    case LIBUSB_ERROR_OVERFLOW:
      return LIBUSB_TRANSFER_OVERFLOW;
    case LIBUSB_ERROR_INTERRUPTED:
      return LIBUSB_TRANSFER_CANCELLED;
    default:
      return LIBUSB_TRANSFER_ERROR;
  }
}

/// Returns the Falcon that HAPTRACE_FALCON describes. Throws Error(input).
std::unique_ptr<EmulatedFalcon> make_falcon() {
  const char* text = std::getenv("HAPTRACE_FALCON");
  const std::string options = text != nullptr ? text : "";
  DeviceSpec spec = DeviceSpec::parse("falcon:emulated=true" + (options.empty() ? "" : "," + options));
  const std::string where = fmt::format("HAPTRACE_FALCON='{}'", options);
  const std::string start = spec.option("start", "switched_on");
  spec.options.erase("start");
  const std::map<std::string, EmulatedFalcon::Start> starts{{"switched_on", EmulatedFalcon::Start::switched_on},
                                                            {"loaded", EmulatedFalcon::Start::loaded},
                                                            {"homed", EmulatedFalcon::Start::homed}};
  const auto found = starts.find(start);
  if (found == starts.end())
    throw input_error(fmt::format("{}: start: expected switched_on, loaded or homed, found '{}'", where, start));
  FalconCalibration calibration;
  if (const std::string file = spec.option("calibration"); !file.empty())
    calibration = read_falcon_calibration(load_json(file), file);
  const std::string fault = spec.option("fault");
  const FalconFaults faults = fault.empty() ? FalconFaults() : FalconFaults::parse(fault, where + ": fault");
  const auto seed = spec.number<std::uint64_t>("seed", 0, std::numeric_limits<std::uint64_t>::max(), 1);
  return std::make_unique<EmulatedFalcon>(calibration, open_live_plant(spec, "falcon"), found->second, faults, seed);
}

/// The bus: one Falcon, and the transfers that programs have submitted.
class Bus {
 public:
  static Bus& instance() {
    static Bus bus;
    return bus;
  }

  /// Plugs the Falcon in. Returns false, after a message on standard error, if HAPTRACE_FALCON is invalid.
  bool plug_in() {
    const std::scoped_lock lock(mutex_);
    if (falcon_) return true;
    try {
      falcon_ = make_falcon();
      falcon_->advance_to(monotonic_ns());
      return true;
    } catch (const std::exception& error) {
      fmt::print(stderr, "libhaptrace-falcon-usb: {}\n", error.what());
      return false;
    }
  }

  [[nodiscard]] bool is_there() {
    const std::scoped_lock lock(mutex_);
    if (!falcon_) return false;
    falcon_->advance_to(monotonic_ns());
    return falcon_->is_there();
  }

  libusb_device_handle* open() {
    if (!is_there()) return nullptr;
    return new libusb_device_handle;
  }

  int claim(const libusb_device_handle* handle) {
    const std::scoped_lock lock(mutex_);
    if (claimed_by_ != nullptr && claimed_by_ != handle) return LIBUSB_ERROR_BUSY;
    claimed_by_ = handle;
    return LIBUSB_SUCCESS;
  }

  int release(const libusb_device_handle* handle) {
    const std::scoped_lock lock(mutex_);
    if (claimed_by_ != handle) return LIBUSB_ERROR_NOT_FOUND;
    claimed_by_ = nullptr;
    return LIBUSB_SUCCESS;
  }

  void close(libusb_device_handle* handle) {
    {
      const std::scoped_lock lock(mutex_);
      if (claimed_by_ == handle) claimed_by_ = nullptr;
      std::erase_if(pending_, [&](const Pending& pending) { return pending.transfer->dev_handle == handle; });
      std::erase_if(ended_, [&](const Ended& ended) { return ended.transfer->dev_handle == handle; });
    }
    delete handle;
  }

  int control(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint8_t* data, std::uint16_t length) {
    if (type == kStandardIn && request == LIBUSB_REQUEST_GET_DESCRIPTOR) return describe(value, data, length);
    if (type != kVendorOut || length != 0) return LIBUSB_ERROR_PIPE;
    const std::scoped_lock lock(mutex_);
    return result_of(falcon_->control(request, value, monotonic_ns()));
  }

  int clear_halt(std::uint8_t endpoint) {
    if (endpoint != kBulkIn && endpoint != kBulkOut) return LIBUSB_ERROR_NOT_FOUND;
    const std::scoped_lock lock(mutex_);
    falcon_->clear_halt(endpoint == kBulkIn);
    return LIBUSB_SUCCESS;
  }

  /// Performs a transfer while the caller waits. `timeout` [ms]; 0: none.
  int transfer_now(std::uint8_t endpoint, std::uint8_t* data, int length, int* transferred, unsigned timeout) {
    if ((endpoint != kBulkIn && endpoint != kBulkOut) || length < 0) return LIBUSB_ERROR_NOT_FOUND;
    const std::int64_t deadline = deadline_after(timeout);
    int done = 0;
    std::optional<int> result;
    std::unique_lock lock(mutex_);
    while (!(result = progress(endpoint, data, length, done))) {
      if (monotonic_ns() >= deadline) {
        result = LIBUSB_ERROR_TIMEOUT;
        break;
      }
      nap(lock, deadline);
    }
    if (transferred != nullptr) *transferred = done;
    return *result;
  }

  int submit(libusb_transfer* transfer) {
    const bool is_bulk = transfer->type == LIBUSB_TRANSFER_TYPE_BULK &&
                         (transfer->endpoint == kBulkIn || transfer->endpoint == kBulkOut);
    if (!is_bulk && transfer->type != LIBUSB_TRANSFER_TYPE_CONTROL) return LIBUSB_ERROR_NOT_SUPPORTED;
    const std::scoped_lock lock(mutex_);
    const auto is_it = [&](const auto& other) { return other.transfer == transfer; };
    if (std::any_of(pending_.begin(), pending_.end(), is_it)) return LIBUSB_ERROR_BUSY;
    if (!falcon_->is_there()) return LIBUSB_ERROR_NO_DEVICE;
    pending_.push_back({transfer, deadline_after(transfer->timeout), 0});
    serve();
    wake_.notify_all();
    return LIBUSB_SUCCESS;
  }

  int cancel(libusb_transfer* transfer) {
    const std::scoped_lock lock(mutex_);
    const auto found = std::find_if(pending_.begin(), pending_.end(),
                                    [&](const Pending& pending) { return pending.transfer == transfer; });
    if (found == pending_.end()) return LIBUSB_ERROR_NOT_FOUND;
    ended_.push_back({transfer, LIBUSB_ERROR_INTERRUPTED, found->done});
    pending_.erase(found);
    wake_.notify_all();
    return LIBUSB_SUCCESS;
  }

  /// Runs the callbacks of transfers that have ended, or that end within `timeout_ns`. Returns as soon as one has run,
  /// or `*completed` is not 0.
  int handle_events(std::int64_t timeout_ns, const int* completed) {
    const std::int64_t deadline = monotonic_ns() + timeout_ns;
    std::unique_lock lock(mutex_);
    while (true) {
      serve();
      if (!ended_.empty() || (completed != nullptr && *completed != 0) || monotonic_ns() >= deadline) break;
      nap(lock, deadline);
    }
    std::deque<Ended> ended;
    ended.swap(ended_);
    lock.unlock();
    for (const Ended& one : ended) finish(one);
    return LIBUSB_SUCCESS;
  }

 private:
  struct Pending {
    libusb_transfer* transfer;
    std::int64_t deadline_ns;
    int done;  ///< transferred bytes
  };
  struct Ended {
    libusb_transfer* transfer;
    int result;  ///< a libusb_error
    int done;    ///< transferred bytes
  };

  static std::int64_t deadline_after(unsigned timeout_ms) {
    return timeout_ms == 0 ? std::numeric_limits<std::int64_t>::max() : monotonic_ns() + 1'000'000LL * timeout_ms;
  }

  /// Waits until something can have happened, until `deadline_ns` at most.
  void nap(std::unique_lock<std::mutex>& lock, std::int64_t deadline_ns) {
    const std::int64_t now = monotonic_ns();
    const std::int64_t until = std::min({deadline_ns, std::max(falcon_->next_in(), now + 10'000), now + kLongestNap});
    wake_.wait_until(lock, std::chrono::steady_clock::time_point(std::chrono::nanoseconds(until)));
  }

  /// Continues a bulk transfer. Returns its result, or nothing while it is in progress. Takes packets until one is
  /// short or the memory is full.
  std::optional<int> progress(std::uint8_t endpoint, std::uint8_t* data, int length, int& done) {
    if (endpoint == kBulkOut) {
      const Handshake handshake = falcon_->out({data, static_cast<std::size_t>(length)}, monotonic_ns());
      if (handshake == Handshake::later) return std::nullopt;
      if (handshake == Handshake::ok) done = length;
      return result_of(handshake);
    }
    std::array<std::uint8_t, EmulatedFalcon::kPacket> packet{};
    while (true) {
      std::size_t size = 0;
      const Handshake handshake = falcon_->in(packet, size, monotonic_ns());
      if (handshake == Handshake::later) return std::nullopt;
      if (handshake != Handshake::ok) return result_of(handshake);
      const int count = std::min(static_cast<int>(size), length - done);
      std::memcpy(data + done, packet.data(), static_cast<std::size_t>(count));
      done += count;
      if (count < static_cast<int>(size)) return LIBUSB_ERROR_OVERFLOW;
      if (size < packet.size() || done == length) return LIBUSB_SUCCESS;
    }
  }

  std::optional<int> progress(Pending& pending) {
    libusb_transfer& transfer = *pending.transfer;
    if (transfer.type != LIBUSB_TRANSFER_TYPE_CONTROL)
      return progress(transfer.endpoint, transfer.buffer, transfer.length, pending.done);
    if (transfer.length < static_cast<int>(LIBUSB_CONTROL_SETUP_SIZE)) return LIBUSB_ERROR_PIPE;
    const auto* setup = reinterpret_cast<const libusb_control_setup*>(transfer.buffer);
    if (setup->bmRequestType != kVendorOut || setup->wLength != 0) return LIBUSB_ERROR_PIPE;
    return result_of(falcon_->control(setup->bRequest, libusb_le16_to_cpu(setup->wValue), monotonic_ns()));
  }

  /// Continues the pending transfers. Those of one endpoint end in the order of their submission.
  void serve() {
    std::array<bool, 256> waits{};
    for (auto pending = pending_.begin(); pending != pending_.end();) {
      bool& waiting = waits[pending->transfer->endpoint];
      std::optional<int> result = waiting ? std::nullopt : progress(*pending);
      if (!result && monotonic_ns() >= pending->deadline_ns) result = LIBUSB_ERROR_TIMEOUT;
      if (!result) {
        waiting = true;
        ++pending;
        continue;
      }
      ended_.push_back({pending->transfer, *result, pending->done});
      pending = pending_.erase(pending);
    }
  }

  static void finish(const Ended& ended) {
    libusb_transfer* transfer = ended.transfer;
    transfer->status = status_of(ended.result);
    transfer->actual_length = ended.done;
    if (transfer->status == LIBUSB_TRANSFER_COMPLETED && (transfer->flags & LIBUSB_TRANSFER_SHORT_NOT_OK) != 0 &&
        transfer->type == LIBUSB_TRANSFER_TYPE_BULK && ended.done < transfer->length)
      transfer->status = LIBUSB_TRANSFER_ERROR;
    const bool is_freed = (transfer->flags & LIBUSB_TRANSFER_FREE_TRANSFER) != 0;
    if (transfer->callback != nullptr) transfer->callback(transfer);
    if (is_freed) libusb_free_transfer(transfer);
  }

  static int describe(std::uint16_t value, std::uint8_t* data, std::uint16_t length);

  std::mutex mutex_;  ///< guards all below
  std::condition_variable wake_;
  std::unique_ptr<EmulatedFalcon> falcon_;
  const libusb_device_handle* claimed_by_ = nullptr;
  std::deque<Pending> pending_;
  std::deque<Ended> ended_;
};

libusb_device_descriptor device_descriptor() {
  libusb_device_descriptor descriptor{};
  descriptor.bLength = LIBUSB_DT_DEVICE_SIZE;
  descriptor.bDescriptorType = LIBUSB_DT_DEVICE;
  descriptor.bcdUSB = 0x0200;
  descriptor.bMaxPacketSize0 = 8;
  descriptor.idVendor = kVendor;
  descriptor.idProduct = kProduct;
  descriptor.bcdDevice = 0x0400;
  descriptor.iManufacturer = 1;
  descriptor.iProduct = 2;
  descriptor.iSerialNumber = 3;
  descriptor.bNumConfigurations = 1;
  return descriptor;
}

/// Writes the device descriptor or a string descriptor, which is UTF-16 after two bytes, and returns its length.
int Bus::describe(std::uint16_t value, std::uint8_t* data, std::uint16_t length) {
  const std::size_t index = value & 0xffU;
  std::vector<std::uint8_t> bytes;
  if (value >> 8U == LIBUSB_DT_DEVICE) {
    const libusb_device_descriptor descriptor = device_descriptor();
    bytes.resize(sizeof descriptor);
    std::memcpy(bytes.data(), &descriptor, sizeof descriptor);
  } else if (value >> 8U == LIBUSB_DT_STRING && index == 0) {
    bytes = {4, LIBUSB_DT_STRING, 0x09, 0x04};
  } else if (value >> 8U == LIBUSB_DT_STRING && index < kTexts.size()) {
    bytes = {0, LIBUSB_DT_STRING};
    for (const char* c = kTexts[index]; *c != 0; ++c) {
      bytes.push_back(static_cast<std::uint8_t>(*c));
      bytes.push_back(0);
    }
    bytes[0] = static_cast<std::uint8_t>(bytes.size());
  } else {
    return LIBUSB_ERROR_PIPE;
  }
  const std::size_t count = std::min<std::size_t>(bytes.size(), length);
  std::memcpy(data, bytes.data(), count);
  return static_cast<int>(count);
}

/// Returns the descriptor of the only configuration: one interface, two bulk endpoints.
libusb_config_descriptor* config_descriptor() {
  static libusb_endpoint_descriptor endpoints[2] = {{.bLength = LIBUSB_DT_ENDPOINT_SIZE,
                                                     .bDescriptorType = LIBUSB_DT_ENDPOINT,
                                                     .bEndpointAddress = kBulkIn,
                                                     .bmAttributes = LIBUSB_TRANSFER_TYPE_BULK,
                                                     .wMaxPacketSize = EmulatedFalcon::kPacket},
                                                    {.bLength = LIBUSB_DT_ENDPOINT_SIZE,
                                                     .bDescriptorType = LIBUSB_DT_ENDPOINT,
                                                     .bEndpointAddress = kBulkOut,
                                                     .bmAttributes = LIBUSB_TRANSFER_TYPE_BULK,
                                                     .wMaxPacketSize = EmulatedFalcon::kPacket}};
  static const libusb_interface_descriptor setting{.bLength = LIBUSB_DT_INTERFACE_SIZE,
                                                   .bDescriptorType = LIBUSB_DT_INTERFACE,
                                                   .bNumEndpoints = 2,
                                                   .bInterfaceClass = LIBUSB_CLASS_VENDOR_SPEC,
                                                   .endpoint = endpoints};
  static const libusb_interface interface { .altsetting = &setting, .num_altsetting = 1 };
  static libusb_config_descriptor config{.bLength = LIBUSB_DT_CONFIG_SIZE,
                                         .bDescriptorType = LIBUSB_DT_CONFIG,
                                         .bNumInterfaces = 1,
                                         .bConfigurationValue = 1,
                                         .bmAttributes = 0x80,
                                         .interface = &interface};
  return &config;
}

}  // namespace
}  // namespace haptrace

using haptrace::Bus;

extern "C" {

int libusb_init(libusb_context** context) {
  if (!Bus::instance().plug_in()) return LIBUSB_ERROR_OTHER;
  if (context != nullptr) *context = &haptrace::the_context;
  return LIBUSB_SUCCESS;
}
void libusb_exit(libusb_context*) {}
void libusb_set_debug(libusb_context*, int) {}
int libusb_set_option(libusb_context*, libusb_option, ...) {
  return LIBUSB_SUCCESS;
}
int libusb_has_capability(std::uint32_t capability) {
  return capability == LIBUSB_CAP_HAS_CAPABILITY ? 1 : 0;
}

ssize_t libusb_get_device_list(libusb_context*, libusb_device*** list) {
  if (!Bus::instance().plug_in()) return LIBUSB_ERROR_OTHER;
  const bool is_there = Bus::instance().is_there();
  *list = static_cast<libusb_device**>(std::calloc(2, sizeof(libusb_device*)));
  if (*list == nullptr) return LIBUSB_ERROR_NO_MEM;
  if (is_there) (*list)[0] = &haptrace::the_device;
  return is_there ? 1 : 0;
}
void libusb_free_device_list(libusb_device** list, int) {
  std::free(list);
}
libusb_device* libusb_ref_device(libusb_device* device) {
  return device;
}
void libusb_unref_device(libusb_device*) {}
int libusb_get_device_descriptor(libusb_device*, libusb_device_descriptor* descriptor) {
  *descriptor = haptrace::device_descriptor();
  return LIBUSB_SUCCESS;
}
int libusb_get_active_config_descriptor(libusb_device*, libusb_config_descriptor** config) {
  *config = haptrace::config_descriptor();
  return LIBUSB_SUCCESS;
}
int libusb_get_config_descriptor(libusb_device*, std::uint8_t index, libusb_config_descriptor** config) {
  if (index != 0) return LIBUSB_ERROR_NOT_FOUND;
  *config = haptrace::config_descriptor();
  return LIBUSB_SUCCESS;
}
void libusb_free_config_descriptor(libusb_config_descriptor*) {}
std::uint8_t libusb_get_bus_number(libusb_device*) {
  return haptrace::kBusNumber;
}
std::uint8_t libusb_get_device_address(libusb_device*) {
  return haptrace::kAddress;
}
std::uint8_t libusb_get_port_number(libusb_device*) {
  return 1;
}
int libusb_get_port_numbers(libusb_device*, std::uint8_t* ports, int length) {
  if (length < 1) return LIBUSB_ERROR_OVERFLOW;
  ports[0] = 1;
  return 1;
}
int libusb_get_device_speed(libusb_device*) {
  return LIBUSB_SPEED_FULL;
}
int libusb_get_max_packet_size(libusb_device*, unsigned char) {
  return haptrace::EmulatedFalcon::kPacket;
}

int libusb_open(libusb_device*, libusb_device_handle** handle) {
  *handle = Bus::instance().open();
  return *handle != nullptr ? LIBUSB_SUCCESS : LIBUSB_ERROR_NO_DEVICE;
}
libusb_device_handle* libusb_open_device_with_vid_pid(libusb_context*, std::uint16_t vendor, std::uint16_t product) {
  return vendor == haptrace::kVendor && product == haptrace::kProduct ? Bus::instance().open() : nullptr;
}
void libusb_close(libusb_device_handle* handle) {
  if (handle != nullptr) Bus::instance().close(handle);
}
libusb_device* libusb_get_device(libusb_device_handle*) {
  return &haptrace::the_device;
}
int libusb_get_configuration(libusb_device_handle*, int* configuration) {
  *configuration = 1;
  return LIBUSB_SUCCESS;
}
int libusb_set_configuration(libusb_device_handle*, int) {
  return LIBUSB_SUCCESS;
}
int libusb_claim_interface(libusb_device_handle* handle, int interface) {
  return interface == 0 ? Bus::instance().claim(handle) : LIBUSB_ERROR_NOT_FOUND;
}
int libusb_release_interface(libusb_device_handle* handle, int interface) {
  return interface == 0 ? Bus::instance().release(handle) : LIBUSB_ERROR_NOT_FOUND;
}
int libusb_set_interface_alt_setting(libusb_device_handle*, int, int) {
  return LIBUSB_SUCCESS;
}
int libusb_clear_halt(libusb_device_handle*, unsigned char endpoint) {
  return Bus::instance().clear_halt(endpoint);
}
int libusb_reset_device(libusb_device_handle*) {
  return LIBUSB_SUCCESS;
}
int libusb_kernel_driver_active(libusb_device_handle*, int) {
  return 0;
}
int libusb_detach_kernel_driver(libusb_device_handle*, int) {
  return LIBUSB_ERROR_NOT_FOUND;
}
int libusb_attach_kernel_driver(libusb_device_handle*, int) {
  return LIBUSB_ERROR_NOT_FOUND;
}
int libusb_set_auto_detach_kernel_driver(libusb_device_handle*, int) {
  return LIBUSB_SUCCESS;
}
int libusb_get_string_descriptor_ascii(libusb_device_handle*, std::uint8_t index, unsigned char* data, int length) {
  if (index == 0 || index >= haptrace::kTexts.size() || length < 1) return LIBUSB_ERROR_INVALID_PARAM;
  const std::string_view text = haptrace::kTexts[index];
  const std::size_t count = std::min(text.size(), static_cast<std::size_t>(length - 1));
  std::memcpy(data, text.data(), count);
  data[count] = 0;
  return static_cast<int>(count);
}

int libusb_control_transfer(libusb_device_handle*, std::uint8_t type, std::uint8_t request, std::uint16_t value,
                            std::uint16_t, unsigned char* data, std::uint16_t length, unsigned) {
  return Bus::instance().control(type, request, value, data, length);
}
int libusb_bulk_transfer(libusb_device_handle*, unsigned char endpoint, unsigned char* data, int length,
                         int* transferred, unsigned timeout) {
  return Bus::instance().transfer_now(endpoint, data, length, transferred, timeout);
}
int libusb_interrupt_transfer(libusb_device_handle*, unsigned char, unsigned char*, int, int*, unsigned) {
  return LIBUSB_ERROR_NOT_FOUND;
}

libusb_transfer* libusb_alloc_transfer(int packets) {
  const std::size_t extra = sizeof(libusb_iso_packet_descriptor) * static_cast<std::size_t>(std::max(packets, 0));
  return static_cast<libusb_transfer*>(std::calloc(1, sizeof(libusb_transfer) + extra));
}
void libusb_free_transfer(libusb_transfer* transfer) {
  if (transfer == nullptr) return;
  if ((transfer->flags & LIBUSB_TRANSFER_FREE_BUFFER) != 0) std::free(transfer->buffer);
  std::free(transfer);
}
int libusb_submit_transfer(libusb_transfer* transfer) {
  return Bus::instance().submit(transfer);
}
int libusb_cancel_transfer(libusb_transfer* transfer) {
  return Bus::instance().cancel(transfer);
}

int libusb_handle_events_timeout_completed(libusb_context*, timeval* timeout, int* completed) {
  return Bus::instance().handle_events(1'000'000'000LL * timeout->tv_sec + 1000LL * timeout->tv_usec, completed);
}
int libusb_handle_events_timeout(libusb_context* context, timeval* timeout) {
  return libusb_handle_events_timeout_completed(context, timeout, nullptr);
}
int libusb_handle_events_completed(libusb_context* context, int* completed) {
  timeval minute{.tv_sec = 60, .tv_usec = 0};
  return libusb_handle_events_timeout_completed(context, &minute, completed);
}
int libusb_handle_events(libusb_context* context) {
  return libusb_handle_events_completed(context, nullptr);
}
int libusb_handle_events_locked(libusb_context* context, timeval* timeout) {
  return libusb_handle_events_timeout_completed(context, timeout, nullptr);
}
int libusb_try_lock_events(libusb_context*) {
  return 0;
}
void libusb_lock_events(libusb_context*) {}
void libusb_unlock_events(libusb_context*) {}
int libusb_event_handling_ok(libusb_context*) {
  return 1;
}
int libusb_event_handler_active(libusb_context*) {
  return 1;
}
void libusb_interrupt_event_handler(libusb_context*) {}
int libusb_get_next_timeout(libusb_context*, timeval*) {
  return 0;
}
int libusb_pollfds_handle_timeouts(libusb_context*) {
  return 1;
}
const libusb_pollfd** libusb_get_pollfds(libusb_context*) {
  return nullptr;
}
void libusb_free_pollfds(const libusb_pollfd**) {}
int libusb_hotplug_register_callback(libusb_context*, int, int, int, int, int, libusb_hotplug_callback_fn, void*,
                                     libusb_hotplug_callback_handle*) {
  return LIBUSB_ERROR_NOT_SUPPORTED;
}
void libusb_hotplug_deregister_callback(libusb_context*, libusb_hotplug_callback_handle) {}
}
