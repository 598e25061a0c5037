// An emulated Inverse Service: what a program that uses an Inverse3 talks to, in front of a simulated plant.
#pragma once

#include "devices/haply/inverse3_messages.h"
#include "devices/sim/live_plant.h"

#include <cstdint>
#include <memory>
#include <string>

namespace haptrace {

/// What goes wrong with it.
enum class InverseFault : std::uint8_t {
  none,
  mute,          ///< takes connections and never speaks
  silent,        ///< answers no command
  closes,        ///< closes the connection at the next command
  garbage,       ///< answers what is no JSON
  partial,       ///< leaves out of an answer what has not changed: no fault, the protocol allows it
  unpowered,     ///< from here on what its status says
  uncalibrated,  //
  not_ready,     //
  in_use,        ///< by another program
  unplugged,     ///< lists no arm
  mirrored,      ///< states another basis from the next answer on, and obeys it
  moved,         ///< states another mount
  filtered,      ///< states another filter
};

struct EmulatedInverseOptions {
  InverseForceKey force_key = InverseForceKey::vector;
  bool tells_version = true;  ///< whether it can be seen what force_key it wants
  std::string device_id = "049D";
  std::string second_device_id;  ///< of an arm that stands still; empty: there is none
  std::string basis = "XYZ";     ///< what it says of its basis, without obeying it
  bool grip = false;             ///< held upright, with button a pressed while the cursor moves right
};

/// A WebSocket server on a free port of this machine, in a thread of its own. It sends its inventory first, then
/// answers every message with one. Positions and forces are those of the documentation's frame (x right, y forward, z
/// up), with the plant's origin 0.12 m towards the user from the base and 0.15 m above it. A force lasts until the next
/// one, for 20 ms at most, and ends with the connection. Answers an error to a force under the other key.
///
/// Threads: every member may be called from any thread.
class EmulatedInverseService {
 public:
  /// Throws Error(device) when it gets no port.
  EmulatedInverseService(LivePlant plant, const EmulatedInverseOptions& options);
  ~EmulatedInverseService();
  EmulatedInverseService(const EmulatedInverseService&) = delete;
  EmulatedInverseService& operator=(const EmulatedInverseService&) = delete;

  [[nodiscard]] std::string url() const;
  [[nodiscard]] std::string events_url() const;

  /// Sends an event to every client of the event channel.
  void report(const std::string& event);
  [[nodiscard]] int listeners() const noexcept;  ///< clients of the event channel

  void inject(InverseFault fault) noexcept;

  [[nodiscard]] Vec3 force() const;             ///< of the motors now, in W [N]
  [[nodiscard]] Vec3 asked() const;             ///< the force that it was asked for last, in W [N]
  [[nodiscard]] int commands() const noexcept;  ///< forces that it was asked for, zero or not
  [[nodiscard]] int sessions() const noexcept;  ///< that are open
  [[nodiscard]] std::string client() const;     ///< who the last session said it is

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace haptrace
