#include "devices/haply/emulated_inverse.h"

#include "base/error.h"
#include "devices/loop/clock.h"

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <fmt/format.h>
#include <mutex>
#include <thread>

namespace haptrace {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;
using nlohmann::json;

constexpr std::int64_t kInverseForceLasts = 20'000'000;  // [ns]

// The documentation's frame, written out: the calibration must not define the frame that tests it.
Vec3 in_service(const Vec3& v) {
  return {v.x(), -v.z(), v.y()};
}
Vec3 from_service(const Vec3& v) {
  return {v.x(), v.z(), -v.y()};
}
Vec3 inverse_base() {
  return {0, -0.12, 0.15};
}

json service_json(const Vec3& v) {
  return {{"x", v.x()}, {"y", v.y()}, {"z", v.z()}};
}

/// Returns the values of `told` that differ from `known`.
json changes_of(const json& told, const json& known) {
  json changes = json::object();
  for (const auto& [key, value] : told.items()) {
    if (!known.contains(key) || !value.is_object()) {
      if (!known.contains(key) || known[key] != value) changes[key] = value;
    } else if (json inner = changes_of(value, known[key]); !inner.empty()) {
      changes[key] = std::move(inner);
    }
  }
  return changes;
}

/// The arm and its commands. A lock guards what other threads ask for.
class EmulatedArm {
 public:
  EmulatedArm(LivePlant plant, const EmulatedInverseOptions& options) : plant_(std::move(plant)), options_(options) {}

  std::atomic<InverseFault> fault{InverseFault::none};
  std::atomic<int> commands{0}, sessions{0};

  [[nodiscard]] Vec3 force() const {
    const std::scoped_lock lock(mutex_);
    return monotonic_ns() < until_ns_ ? force_ : Vec3::Zero();
  }
  [[nodiscard]] Vec3 asked() const {
    const std::scoped_lock lock(mutex_);
    return force_;
  }
  [[nodiscard]] std::string client() const {
    const std::scoped_lock lock(mutex_);
    return client_;
  }

  [[nodiscard]] json inventory() {
    json message{{"session_id", 1}};
    json arm{{"device_id", options_.device_id}, {"config", config()}, {"state", state()}, {"status", status(false)}};
    message["inverse3"] = fault == InverseFault::unplugged ? json::array() : json::array({arm});
    if (!options_.second_device_id.empty()) {
      arm["device_id"] = options_.second_device_id;
      message["inverse3"].push_back(arm);
    }
    add_grip(message);
    return message;
  }

  /// Executes a message and returns the answer. With the fault `partial`, leaves out the values that have not changed
  /// since `known`, the last answer.
  [[nodiscard]] json answer(const json& message, json& known) {
    if (const json profile = message.value("/session/configure/profile/name"_json_pointer, json());
        profile.is_string()) {
      const std::scoped_lock lock(mutex_);
      client_ = profile;
    }
    for (const json& arm : message.value("inverse3", json::array())) {
      if (arm.value("device_id", "") != options_.device_id) continue;
      const json force = arm.value("/commands/set_cursor_force"_json_pointer, json::object());
      const char* key = to_string(options_.force_key);
      if (!force.contains(key)) return {{"error", fmt::format("set_cursor_force: '{}' is missing", key)}};
      const json& vector = force[key];
      command(Vec3(vector.value("x", 0.0), vector.value("y", 0.0), vector.value("z", 0.0)));
      ++commands;
    }
    json told{{"device_id", options_.device_id}, {"state", state()}, {"status", status(true)}};
    if (is_reconfigured()) told["config"] = config();
    if (fault == InverseFault::partial) {
      json changes = changes_of(told, known);
      changes["device_id"] = options_.device_id;
      known = std::move(told);
      told = std::move(changes);
    }
    json reply{{"inverse3", fault == InverseFault::unplugged ? json::array() : json::array({std::move(told)})}};
    add_grip(reply);
    return reply;
  }

  void command(const Vec3& asked) {
    advance();
    const Vec3 force = mirrored(asked);
    const Vec3 in_world = from_service(force);
    plant_.apply(in_world);
    const std::scoped_lock lock(mutex_);
    force_ = in_world;
    until_ns_ = monotonic_ns() + kInverseForceLasts;
  }

  void let_go() {
    advance();
    plant_.apply(Vec3::Zero());
    const std::scoped_lock lock(mutex_);
    until_ns_ = 0;
  }

 private:
  void advance() {
    const std::int64_t now = monotonic_ns();
    if (now > until_ns_) {
      plant_.advance_to(until_ns_);
      plant_.apply(Vec3::Zero());
    }
    plant_.advance_to(now);
  }

  [[nodiscard]] json state() {
    advance();
    Vec3 position = plant_.position();
    const double resolution = plant_.info().position_resolution;
    if (resolution > 0) position = resolution * (position / resolution).array().round().matrix();
    return {{"cursor_position", service_json(mirrored(in_service(position)) + inverse_base())},
            {"cursor_velocity", service_json(mirrored(in_service(plant_.velocity())))},
            {"current_cursor_force", service_json(in_service(force()))},
            {"control_mode", "cursor_force"}};
  }

  /// Returns the status. For a client that commands the arm, the arm is in use, namely by that client.
  [[nodiscard]] json status(bool commands_it) const {
    return {{"calibrated", fault != InverseFault::uncalibrated},
            {"ready", fault != InverseFault::not_ready},
            {"power_supply", fault != InverseFault::unpowered},
            {"in_use", fault == InverseFault::in_use || commands_it}};
  }

  [[nodiscard]] json config() const {
    json config{{"type", "inverse3"}, {"handedness", "right"}, {"gravity_compensation", {{"enabled", true}}}};
    if (options_.tells_version && options_.force_key == InverseForceKey::vector) {
      config["preset"] = "defaults";
      config["basis"] = {{"permutation", fault == InverseFault::mirrored ? "-X+Y+Z" : options_.basis}};
      config["mount"] = {{"position", {{"x", 0.0}, {"y", 0.0}, {"z", fault == InverseFault::moved ? 0.02 : 0.0}}}};
      config["filters"] = {{"velocity_hz", fault == InverseFault::filtered ? 20 : 200}};
    }
    return config;
  }

  [[nodiscard]] bool is_reconfigured() const {
    const InverseFault now = fault;
    return now == InverseFault::mirrored || now == InverseFault::moved || now == InverseFault::filtered;
  }

  /// Mirrors `v` if the basis of the service is mirrored.
  [[nodiscard]] Vec3 mirrored(const Vec3& v) const {
    return fault == InverseFault::mirrored ? Vec3(-v.x(), v.y(), v.z()) : v;
  }

  void add_grip(json& message) const {
    if (!options_.grip) return;
    const json state{{"orientation", {{"w", 1.0}, {"x", 0.0}, {"y", 0.0}, {"z", 0.0}}},
                     {"buttons", {{"a", plant_.velocity().x() > 0}, {"b", false}, {"c", false}}}};
    message["wireless_verse_grip"] = json::array({{{"device_id", "61576"}, {"state", state}}});
  }

  LivePlant plant_;
  const EmulatedInverseOptions options_;
  mutable std::mutex mutex_;  ///< guards all below
  Vec3 force_ = Vec3::Zero();
  std::int64_t until_ns_ = 0;  ///< end of the force; written by the server's thread alone [ns]
  std::string client_;
};

/// One client. It lives as long as an operation for it is pending.
class InverseSession : public std::enable_shared_from_this<InverseSession> {
 public:
  InverseSession(tcp::socket socket, EmulatedArm& arm) : stream_(std::move(socket)), arm_(arm) { ++arm_.sessions; }
  ~InverseSession() {
    if (commands_) arm_.let_go();
    --arm_.sessions;
  }
  InverseSession(const InverseSession&) = delete;
  InverseSession& operator=(const InverseSession&) = delete;

  void start() {
    error_code ignored;
    stream_.next_layer().set_option(tcp::no_delay(true), ignored);
    if (arm_.fault == InverseFault::mute) return linger();
    stream_.async_accept([self = shared_from_this()](error_code error) {
      if (!error) self->write(self->arm_.inventory().dump());
    });
  }

 private:
  /// Keeps the connection until the client closes it.
  void linger() {
    stream_.next_layer().async_read_some(buffer_.prepare(4096),
                                         [self = shared_from_this()](error_code error, std::size_t) {
                                           if (!error) self->linger();
                                         });
  }

  void read() {
    stream_.async_read(buffer_, [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return;
      const json message = json::parse(boost::beast::buffers_to_string(self->buffer_.data()), nullptr, false);
      self->buffer_.clear();
      self->serve(message);
    });
  }

  void serve(const json& message) {
    commands_ = true;
    std::string reply;
    try {
      reply = arm_.answer(message, known_).dump();
    } catch (const json::exception&) {
      return;  // closes the connection
    }
    switch (arm_.fault) {
      case InverseFault::silent:
        return read();
      case InverseFault::closes:
        return;
      case InverseFault::garbage:
        return write("{] Internal Server Error");
      default:
        return write(std::move(reply));
    }
  }

  void write(std::string text) {
    outgoing_ = std::move(text);
    stream_.async_write(asio::buffer(outgoing_), [self = shared_from_this()](error_code error, std::size_t) {
      if (!error) self->read();
    });
  }

  websocket::stream<tcp::socket> stream_;
  EmulatedArm& arm_;
  boost::beast::flat_buffer buffer_;
  std::string outgoing_;
  json known_ = json::object();
  bool commands_ = false;
};

/// A client of the event channel.
class InverseListener : public std::enable_shared_from_this<InverseListener> {
 public:
  InverseListener(tcp::socket socket, std::atomic<int>& count) : stream_(std::move(socket)), count_(count) {}
  ~InverseListener() {
    if (listens_) --count_;
  }
  InverseListener(const InverseListener&) = delete;
  InverseListener& operator=(const InverseListener&) = delete;

  void start() {
    stream_.async_accept([self = shared_from_this()](error_code error) {
      if (error) return;
      self->listens_ = true;
      ++self->count_;
      self->wait_for_end();
    });
  }
  void say(const std::string& event) {
    if (!listens_) return;
    error_code ignored;
    stream_.write(asio::buffer(event), ignored);
  }

 private:
  void wait_for_end() {
    stream_.async_read(buffer_, [self = shared_from_this()](error_code error, std::size_t) {
      if (!error) self->wait_for_end();
    });
  }

  websocket::stream<tcp::socket> stream_;
  std::atomic<int>& count_;
  boost::beast::flat_buffer buffer_;
  bool listens_ = false;
};

/// Opens `acceptor` on a free port of this machine and returns the port. Throws boost::system::system_error.
std::uint16_t listen_on_free_port(tcp::acceptor& acceptor) {
  const tcp::endpoint endpoint(asio::ip::address_v4::loopback(), 0);
  acceptor.open(endpoint.protocol());
  acceptor.bind(endpoint);
  acceptor.listen();
  return acceptor.local_endpoint().port();
}

}  // namespace

class EmulatedInverseService::Server {
 public:
  Server(LivePlant plant, const EmulatedInverseOptions& options) : arm(std::move(plant), options) {
    try {
      port_ = listen_on_free_port(acceptor_);
      events_port_ = listen_on_free_port(events_acceptor_);
    } catch (const boost::system::system_error& error) {
      throw device_error(
          fmt::format("the emulated Inverse Service cannot open a port of this machine: {}; close programs that hold "
                      "many connections",
                      error.code().message()));
    }
    accept();
    accept_listeners();
    thread_ = std::jthread([this] { io_.run(); });
  }
  ~Server() { io_.stop(); }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::uint16_t events_port() const { return events_port_; }

  void report(const std::string& event) {
    asio::post(io_, [this, event] {
      std::erase_if(listeners_, [](const auto& listener) { return listener.expired(); });
      for (const auto& listener : listeners_)
        if (const auto alive = listener.lock()) alive->say(event);
    });
  }

  EmulatedArm arm;  ///< declared before io_, because the sessions end with io_
  std::atomic<int> listening{0};

 private:
  void accept_listeners() {
    events_acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error) return;
      const auto listener = std::make_shared<InverseListener>(std::move(socket), listening);
      listeners_.push_back(listener);
      listener->start();
      accept_listeners();
    });
  }

  void accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error) return;
      std::make_shared<InverseSession>(std::move(socket), arm)->start();
      accept();
    });
  }

  std::vector<std::weak_ptr<InverseListener>> listeners_;
  asio::io_context io_{1};
  tcp::acceptor acceptor_{io_}, events_acceptor_{io_};
  std::uint16_t port_ = 0, events_port_ = 0;
  std::jthread thread_;
};

EmulatedInverseService::EmulatedInverseService(LivePlant plant, const EmulatedInverseOptions& options)
    : server_(std::make_unique<Server>(std::move(plant), options)) {}

EmulatedInverseService::~EmulatedInverseService() = default;

std::string EmulatedInverseService::url() const {
  return fmt::format("ws://127.0.0.1:{}", server_->port());
}

std::string EmulatedInverseService::events_url() const {
  return fmt::format("ws://127.0.0.1:{}", server_->events_port());
}

void EmulatedInverseService::report(const std::string& event) {
  server_->report(event);
}

int EmulatedInverseService::listeners() const noexcept {
  return server_->listening;
}

void EmulatedInverseService::inject(InverseFault fault) noexcept {
  server_->arm.fault = fault;
}

Vec3 EmulatedInverseService::force() const {
  return server_->arm.force();
}

Vec3 EmulatedInverseService::asked() const {
  return server_->arm.asked();
}

int EmulatedInverseService::commands() const noexcept {
  return server_->arm.commands;
}

int EmulatedInverseService::sessions() const noexcept {
  return server_->arm.sessions;
}

std::string EmulatedInverseService::client() const {
  return server_->arm.client();
}

}  // namespace haptrace
