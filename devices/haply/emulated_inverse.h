// Emulation of the Inverse Service in front of a simulated plant, for programs that use an Inverse3.
#pragma once

#include "devices/haply/inverse3_messages.h"
#include "devices/sim/live_plant.h"

#include <cstdint>
#include <memory>
#include <string>

namespace haptrace {

/// Faults of the emulated service.
enum class InverseFault : std::uint8_t {
  none,
  mute,          ///< accepts connections and never sends a message
  silent,        ///< answers no command
  closes,        ///< closes the connection at the next command
  garbage,       ///< answers with invalid JSON
  partial,       ///< leaves unchanged values out of an answer: no fault, the protocol allows it
  unpowered,     ///< as its status reports, like the next three
  uncalibrated,  //
  not_ready,     //
  in_use,        ///< in use by another program
  unplugged,     ///< lists no arm
  mirrored,      ///< reports another basis from the next answer on, and obeys it
  moved,         ///< reports another mount
  filtered,      ///< reports another filter
};

struct EmulatedInverseOptions {
  InverseForceKey force_key = InverseForceKey::vector;
  bool tells_version = true;  ///< its messages show which force_key it expects
  std::string device_id = "049D";
  std::string second_device_id;  ///< id of a second arm, which stands still; empty: there is none
  std::string basis = "XYZ";     ///< basis that it reports without obeying it
  bool grip = false;             ///< there is a grip, held upright, with button a pressed while the cursor moves right
};

/// A WebSocket server on a free port of this machine, with its own thread. It sends its inventory first, then answers
/// every message with one. Positions and forces are in the documentation's frame (x right, y forward, z up), with the
/// plant's origin 0.12 m towards the user from the base and 0.15 m above it. A force lasts until the next one, for 20
/// ms at most, and ends with the connection. The service answers a force under the other key with an error.
///
/// Threads: every member may be called from any thread.
class EmulatedInverseService {
 public:
  /// Starts the server. Throws Error(device) if it gets no port.
  EmulatedInverseService(LivePlant plant, const EmulatedInverseOptions& options);
  ~EmulatedInverseService();
  EmulatedInverseService(const EmulatedInverseService&) = delete;
  EmulatedInverseService& operator=(const EmulatedInverseService&) = delete;

  [[nodiscard]] std::string url() const;
  [[nodiscard]] std::string events_url() const;

  /// Sends an event to every client of the event channel.
  void report(const std::string& event);
  [[nodiscard]] int listeners() const noexcept;  ///< number of clients of the event channel

  void inject(InverseFault fault) noexcept;

  [[nodiscard]] Vec3 force() const;             ///< current force of the motors, in W [N]
  [[nodiscard]] Vec3 asked() const;             ///< last requested force, in W [N]
  [[nodiscard]] int commands() const noexcept;  ///< number of requested forces, zero or not
  [[nodiscard]] int sessions() const noexcept;  ///< number of open sessions
  [[nodiscard]] std::string client() const;     ///< name that the last session reported

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace haptrace
