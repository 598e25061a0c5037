#include "devices/haply/inverse3.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/number.h"
#include "devices/haply/emulated_inverse.h"
#include "devices/loop/clock.h"
#include "devices/sim/live_plant.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <fmt/format.h>

namespace haptrace {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;

constexpr double kInverseConnects = 0.5;            // [s], and as long again for the upgrade to a WebSocket
constexpr double kInverseInventory = 1;             // [s]
constexpr double kInverseReply = 0.01;              // per round [s]
constexpr double kInverseFirstReply = 0.8;          // [s]
constexpr double kInverseSilence = 0.08;            // before ThreadedDevice gives up with a less precise message [s]
constexpr double kInverseFarewell = 0.1;            // [s]
constexpr double kInverseSearch = 0.05;             // per step of a search [s]
constexpr double kInverseUnlisted = 0.05;           // time after which an arm missing from the answers is gone [s]
constexpr std::size_t kInverseLongest = 1U << 20U;  // longest message [bytes]

constexpr const char* kStartService =
    "start Haply's Inverse Service (sudo systemctl start haply-inverse-service, or open the Haply Hub)";
constexpr const char* kRestartService = "restart the service: sudo systemctl restart haply-inverse-service";

struct InverseUrl {
  std::string text, host, path;
  std::vector<asio::ip::address> addresses;  ///< tried in turn
  std::uint16_t port = 80;
};

/// Parses a URL. Asks no name server, because such a query cannot be cancelled in time.
InverseUrl parse_inverse_url(const std::string& text, bool remote) {
  const auto refuse = [&](const std::string& why) {
    return input_error(fmt::format("url '{}': {}; expected, for example, ws://localhost:10001", text, why));
  };
  constexpr std::string_view kScheme = "ws://";
  if (!text.starts_with(kScheme)) throw refuse("it does not begin with ws://");
  const std::string rest = text.substr(kScheme.size());
  const auto slash = rest.find('/');
  const std::string authority = rest.substr(0, slash);
  InverseUrl url{.text = text, .host = authority, .path = slash == std::string::npos ? "/" : rest.substr(slash)};

  std::string name = authority;
  const auto colon = authority.rfind(':');
  if (colon != std::string::npos && authority.find(']', colon) == std::string::npos) {
    name = authority.substr(0, colon);
    url.port = number_of<std::uint16_t>(std::string_view(authority).substr(colon + 1)).value_or(0);
    if (url.port == 0) throw refuse("its port is not from 1 to 65535");
  }
  if (name == "localhost") {
    url.addresses = {asio::ip::address_v4::loopback(), asio::ip::address_v6::loopback()};
    return url;
  }
  if (name.size() > 2 && name.front() == '[' && name.back() == ']') name = name.substr(1, name.size() - 2);
  error_code error;
  url.addresses = {asio::ip::make_address(name, error)};
  if (error) throw refuse("its host is neither localhost nor a numeric address");
  if (!remote && !url.addresses.front().is_loopback())
    throw refuse("it leads to another machine, and a stalled network removes the force; add remote=true to allow this");
  return url;
}

/// Returns the default URL of the event channel, on the service's host.
InverseUrl events_of(const InverseUrl& service) {
  InverseUrl events = service;
  constexpr std::uint16_t kEventsPort = 10020;
  const auto colon = service.host.rfind(':');
  const bool has_port = colon != std::string::npos && service.host.find(']', colon) == std::string::npos;
  events.host = fmt::format("{}:{}", has_port ? service.host.substr(0, colon) : service.host, kEventsPort);
  events.port = kEventsPort;
  events.path = "/";
  events.text = "ws://" + events.host;
  return events;
}

/// A WebSocket connection whose calls wait no longer than their timeouts. Reads as long as it is open.
class InverseConnection {
 public:
  /// Connects to the service. Throws Error(device) if there is none.
  InverseConnection(const InverseUrl& url, double patience) : stream_(io_) {
    std::optional<std::string> why;  // failure of the first address
    for (const asio::ip::address& address : url.addresses) {
      const std::string refused = connect({address, url.port}, patience);
      if (!why || refused.empty()) why = refused;
      if (refused.empty()) break;
    }
    if (!why->empty())
      throw device_error(fmt::format("no Inverse Service at {}: {}; {}", url.text, *why, kStartService));
    upgrade(url, patience);
    read();
  }
  ~InverseConnection() { close(); }
  InverseConnection(const InverseConnection&) = delete;
  InverseConnection& operator=(const InverseConnection&) = delete;

  /// Starts to send the message, after waiting until the previous one was sent. Throws Error(device) if the connection
  /// broke or the service takes no more messages.
  void send(std::string message, double timeout) {
    if (!wait(timeout, [this] { return !writing_ || failure_; }))
      throw device_error(fmt::format("the Inverse Service accepts no more messages; {}", kRestartService));
    check();
    outgoing_ = std::move(message);
    writing_ = true;
    stream_.async_write(asio::buffer(outgoing_), [this](error_code error, std::size_t) {
      writing_ = false;
      fail(error);
    });
  }

  /// Returns the next message; nothing if none came in time. Throws Error(device) if the connection broke.
  std::optional<std::string> receive(double timeout) {
    if (!wait(timeout, [this] { return received_ || failure_; })) return {};
    if (!received_) check();
    std::optional<std::string> message = std::move(received_);
    received_.reset();
    read();
    return message;
  }

  /// Closes the connection, with a WebSocket close message if it still works.
  void close() noexcept {
    if (closed_) return;
    closed_ = true;
    try {
      if (!failure_ && stream_.is_open()) {
        stream_.async_close(websocket::close_code::normal, [this](error_code error) { fail(error ? error : kGone); });
        wait(kInverseFarewell, [this] { return failure_.has_value(); });
      }
    } catch (...) {
      // The socket is closed in any case.
    }
    error_code ignored;
    stream_.next_layer().close(ignored);
  }

 private:
  static inline const error_code kGone = make_error_code(websocket::error::closed);

  /// Runs pending operations until `done`, for `timeout` [s] at most. Returns whether it is done.
  template <class Done>
  bool wait(double timeout, Done done) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::microseconds(std::lround(1e6 * timeout));
    bool in_time = true;
    while (!done() && in_time) {
      io_.restart();
      in_time = io_.run_one_until(deadline) > 0;
    }
    if (in_time) return true;
    io_.restart();
    io_.poll();  // handles data that came while this thread did not run
    return done();
  }

  void fail(error_code error) {
    if (error && !failure_) failure_ = error;
  }
  void check() const {
    if (failure_)
      throw device_error(
          fmt::format("the Inverse Service closed the connection ({}); {}", failure_->message(), kStartService));
  }

  /// Connects to `endpoint`. Returns the reason for a failure; empty if there was none.
  std::string connect(const tcp::endpoint& endpoint, double patience) {
    std::optional<error_code> answer;
    tcp::socket& socket = stream_.next_layer();
    error_code ignored;
    socket.close(ignored);
    socket.async_connect(endpoint, [&answer](error_code error) { answer = error; });
    if (!wait(patience, [&] { return answer.has_value(); })) {
      socket.close(ignored);
      wait(patience, [&] { return answer.has_value(); });  // the handler refers to local variables
      return fmt::format("no answer within {:g} s", patience);
    }
    if (*answer) return answer->message();
    socket.set_option(tcp::no_delay(true), ignored);
    return "";
  }

  void upgrade(const InverseUrl& url, double patience) {
    std::optional<error_code> answer;
    stream_.read_message_max(kInverseLongest);
    stream_.async_handshake(url.host, url.path, [&answer](error_code error) { answer = error; });
    if (!wait(patience, [&] { return answer.has_value(); })) {
      error_code ignored;
      stream_.next_layer().close(ignored);
      wait(patience, [&] { return answer.has_value(); });
      answer = make_error_code(boost::system::errc::timed_out);
    }
    if (*answer)
      throw device_error(fmt::format("the program at {} is not an Inverse Service ({}); check the url, or {}", url.text,
                                     answer->message(), kRestartService));
  }

  void read() {
    stream_.async_read(buffer_, [this](error_code error, std::size_t) {
      if (error) return fail(error);
      received_ = boost::beast::buffers_to_string(buffer_.data());
      buffer_.clear();
    });
  }

  boost::beast::flat_buffer buffer_;
  std::string outgoing_;
  std::optional<std::string> received_;
  std::optional<error_code> failure_;
  bool writing_ = false, closed_ = false;
  asio::io_context io_{1};  ///< declared after the members that its handlers refer to
  websocket::stream<tcp::socket> stream_;
};

/// Takes the first message of the service. Throws Error(device) if none comes.
void await_inventory(InverseConnection& connection, const InverseUrl& url, double patience, InverseServiceView& view) {
  const auto inventory = connection.receive(patience);
  if (!inventory)
    throw device_error(fmt::format("the Inverse Service at {} sends nothing; {}", url.text, kRestartService));
  view.take(*inventory);
}

std::string inverse_model(const std::string& type) {
  if (type == "inverse3") return "Haply Inverse3";
  if (type == "inverse3x") return "Haply Inverse3x";
  if (type == "minverse") return "Haply Minverse";
  return "Haply " + type;
}

constexpr const char* kNoArm = "check its cable and its power, and whether the Haply Hub shows it";

/// Returns the requested arm. Throws Error(device) if there is none or the choice is ambiguous.
std::string chosen_arm(const InverseServiceView& view, const std::string& asked) {
  const std::vector<std::string>& listed = view.listed();
  if (listed.empty()) throw device_error(fmt::format("the Inverse Service lists no Inverse3; {}", kNoArm));
  if (!asked.empty() && !view.lists(asked))
    throw device_error(fmt::format("the Inverse Service does not list an Inverse3 '{}'. It lists {}; {}", asked,
                                   fmt::join(listed, ", "), kNoArm));
  if (asked.empty() && listed.size() > 1)
    throw device_error(fmt::format("the Inverse Service lists {}; select one, for example with device_id={}",
                                   fmt::join(listed, ", "), listed.front()));
  return asked.empty() ? listed.front() : asked;
}

void refuse_obstacle(const std::string& id, const InverseArm& arm, bool ours) {
  const InverseObstacle obstacle = obstacle_of(arm, ours);
  if (!obstacle.what.empty())
    throw device_error(fmt::format("Inverse3 {}: {}; {}", id, obstacle.what, obstacle.remedy));
}

class Inverse3Driver final : public DeviceDriver {
 public:
  explicit Inverse3Driver(const Inverse3Options& options)
      : Inverse3Driver(options, parse_inverse_url(options.url, options.remote)) {}
  ~Inverse3Driver() override { (void)release(); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }

  bool round(const Wrench& wrench, DeviceState& state) override {
    const Vec3 force = calibration_.command(wrench.force);
    const bool zero = force.isZero(0);
    // Sends one message per reply, but sends a zero force even if a reply is due.
    if (owed_ == 0 || (zero && !sent_zero_)) send(force, zero);
    const std::int64_t asked_ns = monotonic_ns();
    const auto reply = connection_.receive(kInverseReply);
    if (!reply) {
      silence_ += std::min(since(asked_ns), 2 * kInverseReply);  // a longer wait means that this process was stopped
      if (silence_ > (answered_ ? kInverseSilence : kInverseFirstReply))
        throw device_error(
            fmt::format("the Inverse Service does not answer{}; {}", answered_ ? " any more" : "", kRestartService));
      return false;
    }
    answered_ = true;
    silence_ = 0;
    owed_ = std::max(owed_ - 1, 0);
    view_.take(*reply);
    if (!accepted()) return false;
    if (!view_.lists(id_)) {
      if (since(listed_ns_) > kInverseUnlisted)
        throw device_error(fmt::format("the Inverse Service no longer lists Inverse3 {}; {}", id_, kNoArm));
      return false;
    }
    listed_ns_ = monotonic_ns();
    read(state);
    heed_events();
    return true;
  }

  ZeroForce release() noexcept override {
    if (released_) return *released_;
    released_ = ZeroForce::failed;
    try {
      send(Vec3::Zero(), true);
      released_ = ZeroForce::sent;
      // Until the service answers, it may not have read the message, which is then lost with the connection.
      bool answered = true;
      for (; owed_ > 0 && answered; --owed_) answered = connection_.receive(kInverseFarewell).has_value();
      if (answered) released_ = ZeroForce::confirmed;
    } catch (const std::exception&) {
      // The service is not reachable; it removes the force by itself as soon as commands stop.
    }
    connection_.close();
    return *released_;
  }

 private:
  Inverse3Driver(const Inverse3Options& options, const InverseUrl& url)
      : calibration_(options.calibration.value_or(Inverse3Calibration{})), connection_(url, kInverseConnects) {
    await_inventory(connection_, url, kInverseInventory, view_);
    id_ = chosen_arm(view_, options.device_id);
    const InverseArm arm = view_.arm(id_);
    refuse_obstacle(id_, arm, false);
    if (!arm.displaced.empty() && !options.calibration)
      throw device_error(
          fmt::format("Inverse3 {}: a setting of its service moves its axes ({}), so they differ from the documented "
                      "axes; choose the preset 'defaults' in the Haply Hub, or describe the axes with calibration=FILE",
                      id_, fmt::join(arm.displaced, ", ")));
    opened_as_ = arm;
    listen_to_events(options, url);
    force_key_ = options.force_key.value_or(view_.force_key());
    may_change_key_ = !options.force_key;

    info_.name = options.name;
    info_.backend = "inverse3";
    info_.model = inverse_model(arm.type);
    info_.serial = id_;
    info_.measures_velocity = arm.velocity.has_value();
    info_.measures_orientation = view_.grip().has_value();
    info_.workspace_min = -calibration_.workspace;
    info_.workspace_max = calibration_.workspace;
    info_.max_force = calibration_.max_force;
    info_.max_continuous_force = calibration_.max_continuous_force;
  }

  /// Connects to the channel for safety events, which the service has since version 3.5. If it is missing, a note in
  /// `info_` says which events haptrace does not see.
  void listen_to_events(const Inverse3Options& options, const InverseUrl& url) {
    if (options.events == "off") return;
    const InverseUrl events =
        options.events.empty() ? events_of(url) : parse_inverse_url(options.events, options.remote);
    try {
      events_.emplace(events, kInverseConnects);
    } catch (const Error&) {
      info_.notes.push_back(fmt::format(
          "the Inverse Service has no event channel at {}: haptrace does not see its safety events (emergency brake, "
          "stalled motor); update the service to version 3.5 or set events=URL",
          events.text));
    }
  }

  /// Throws Error(device) if the service reports that the arm no longer follows commands.
  void heed_events() {
    while (events_) {
      std::optional<std::string> message;
      try {
        message = events_->receive(0);
      } catch (const Error&) {
        events_.reset();  // a service that ended also closes the other connection
        return;
      }
      if (!message) return;
      const auto event = inverse_event(*message);
      if (!event || !event->ends_control()) continue;
      if (event->device == id_ || (event->device.empty() && !event->type.empty()))
        throw device_error(fmt::format(
            "Inverse3 {}: its service reports {} ({:.120}); release the emergency brake, free the handle, then start "
            "the session again",
            id_, event->type.empty() ? event->name : event->type, event->message));
    }
  }

  static double since(std::int64_t ns) { return 1e-9 * static_cast<double>(monotonic_ns() - ns); }

  void send(const Vec3& force, bool zero) {
    connection_.send(inverse_command(id_, force, force_key_, first_), kInverseReply);
    ++owed_;
    sent_zero_ = zero;
    first_ = false;
  }

  /// Returns whether the service accepted the command. The force key is not known for every version, so before the
  /// first accepted command the other key is tried once. Until then no force acts.
  bool accepted() {
    if (view_.refusal().empty()) {
      may_change_key_ = false;
      return true;
    }
    if (!may_change_key_)
      throw device_error(fmt::format(
          "the Inverse Service refuses a force ('{:.200}'); try force_key={}", view_.refusal(),
          to_string(force_key_ == InverseForceKey::vector ? InverseForceKey::values : InverseForceKey::vector)));
    may_change_key_ = false;
    force_key_ = force_key_ == InverseForceKey::vector ? InverseForceKey::values : InverseForceKey::vector;
    return false;
  }

  void read(DeviceState& state) {
    const InverseArm arm = view_.arm(id_);
    refuse_obstacle(id_, arm, true);
    // A force computed in the old axes would act in the new ones.
    if (const std::string changed = changed_setting(opened_as_, arm); !changed.empty())
      throw device_error(fmt::format(
          "Inverse3 {}: its service changed a setting while the device was open ({}); choose the preset 'defaults' in "
          "the Haply Hub, close other programs that configure the service, then start the session again",
          id_, changed));
    opened_as_.complete(arm);
    state = {};
    state.position = calibration_.position(arm.position);
    if (info_.measures_velocity) state.velocity = calibration_.vector(arm.velocity.value_or(Vec3::Zero()));
    const auto grip = view_.grip();
    if (!grip) return;
    state.buttons = grip->buttons;
    if (info_.measures_orientation) state.orientation = calibration_.orientation(grip->orientation);
  }

  const Inverse3Calibration calibration_;
  InverseConnection connection_;
  std::optional<InverseConnection> events_;
  InverseServiceView view_;
  InverseArm opened_as_;  ///< settings at its opening
  DeviceInfo info_;
  std::string id_;
  InverseForceKey force_key_ = InverseForceKey::vector;
  bool may_change_key_ = true, first_ = true, sent_zero_ = false;
  std::optional<ZeroForce> released_;
  bool answered_ = false;
  double silence_ = 0;                       ///< time without an answer [s]
  std::int64_t listed_ns_ = monotonic_ns();  ///< time of the last answer that listed the arm
  int owed_ = 0;                             ///< replies that are due
};

/// A driver together with its emulated service.
class EmulatedInverse3Driver final : public DeviceDriver {
 public:
  EmulatedInverse3Driver(LivePlant plant, Inverse3Options options)
      : plant_(plant.info()),
        service_(std::move(plant), {}),
        driver_(open_at(service_, options)),
        info_(driver_->info()) {
    info_.model += " (emulated)";
    info_.natural_duration = plant_.natural_duration;
    info_.notes.insert(info_.notes.end(), plant_.notes.begin(), plant_.notes.end());
  }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  bool round(const Wrench& wrench, DeviceState& state) override { return driver_->round(wrench, state); }
  ZeroForce release() noexcept override { return driver_->release(); }

 private:
  static std::unique_ptr<DeviceDriver> open_at(const EmulatedInverseService& service, Inverse3Options& options) {
    options.url = service.url();
    options.events = service.events_url();
    return open_inverse3_driver(options);
  }

  const DeviceInfo plant_;
  EmulatedInverseService service_;
  std::unique_ptr<DeviceDriver> driver_;
  DeviceInfo info_;
};

Inverse3Options read_inverse3_options(const DeviceSpec& device) {
  Inverse3Options options{.name = device.text, .force_key = {}, .calibration = {}};
  options.url = device.option("url", options.url);
  options.device_id = device.option("device_id");
  options.remote = device.flag("remote");
  options.events = device.option("events");
  if (const std::string key = device.option("force_key"); !key.empty()) {
    const std::string vector = to_string(InverseForceKey::vector), values = to_string(InverseForceKey::values);
    if (key != vector && key != values)
      throw input_error(
          fmt::format("{}: force_key: expected {} or {}, found '{}'", device.where(), vector, values, key));
    options.force_key = key == values ? InverseForceKey::values : InverseForceKey::vector;
  }
  if (const std::string file = device.option("calibration"); !file.empty())
    options.calibration = read_inverse3_calibration(load_json(file), file);
  return options;
}

std::unique_ptr<Device> open_inverse3(const DeviceSpec& device) {
  Inverse3Options options = read_inverse3_options(device);
  if (!is_emulated(device)) return std::make_unique<ThreadedDevice>(open_inverse3_driver(options));
  LivePlant plant = open_live_plant(device, "inverse3");
  if (!options.calibration) {
    // Takes the workspace and forces of the requested plant, in the service's own axes.
    options.calibration.emplace();
    const DeviceInfo& info = plant.info();
    options.calibration->workspace = info.workspace_max.cwiseMin(-info.workspace_min).cwiseMax(1e-3);
    options.calibration->max_force = info.max_force;
    options.calibration->max_continuous_force = info.max_continuous_force;
  }
  return std::make_unique<ThreadedDevice>(std::make_unique<EmulatedInverse3Driver>(std::move(plant), options));
}

}  // namespace

std::unique_ptr<DeviceDriver> open_inverse3_driver(const Inverse3Options& options) {
  return std::make_unique<Inverse3Driver>(options);
}

std::vector<FoundDevice> find_inverse3(const std::string& url_text) {
  std::vector<FoundDevice> found;
  try {
    const InverseUrl url = parse_inverse_url(url_text, false);
    InverseConnection connection(url, kInverseSearch);
    InverseServiceView view;
    await_inventory(connection, url, kInverseSearch, view);
    for (const std::string& id : view.listed()) {
      const InverseArm arm = view.arm(id);
      const InverseObstacle obstacle = obstacle_of(arm, false);
      found.push_back({.spec = view.listed().size() > 1 ? "inverse3:device_id=" + id : "inverse3",
                       .model = inverse_model(arm.type),
                       .serial = id,
                       .where = url.text,
                       .obstacle = obstacle.what,
                       .remedy = obstacle.remedy});
    }
    if (found.empty())
      found.push_back({.spec = "inverse3",
                       .model = "Haply Inverse Service",
                       .serial = "",
                       .where = url.text,
                       .obstacle = "it lists no Inverse3",
                       .remedy = kNoArm});
  } catch (const std::exception&) {
    // There is no service, or another program has the port: there is nothing to open.
  }
  return found;
}

DeviceBackend inverse3_backend() {
  DeviceBackend backend{
      .name = "inverse3",
      .summary = "Haply Inverse3, through Haply's Inverse Service (docs/devices/inverse3.md)",
      .options = {{"url", "URL of the service (default ws://localhost:10001)"},
                  {"device_id", "id of the device, if there are several; haptrace devices shows it"},
                  {"remote", "true: allow a url with the numeric address of another machine"},
                  {"events", "URL of the service's event channel (default: its host, port 10020), or off"},
                  {"force_key", "key of a force, if the service is not recognised: vector (3.5) or values (3.1)"},
                  {"calibration", "JSON file with the axes, origin, workspace and force limits of the arm"}},
      .presets = {},
      .open = open_inverse3,
      .find = [] { return find_inverse3(Inverse3Options{}.url); },
      .opens_still = true};
  for (DeviceBackend::Option& option : emulated_options()) backend.options.push_back(std::move(option));
  return backend;
}

}  // namespace haptrace
