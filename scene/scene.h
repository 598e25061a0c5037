// All objects that the hand can touch.
#pragma once

#include "scene/broad_phase.h"
#include "scene/contact_list.h"
#include "scene/object.h"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// The answer of a scene.
struct SceneAnswer {
  Vec3 force = Vec3::Zero();          ///< sum over all objects, on the hand, in W [N]
  double stored = 0;                  ///< sum over all objects [J]
  std::span<const Contact> contacts;  ///< with the objects near the tool, in the scene's order; valid until the next
};

/// Interface between a session and a scene. A session queries it at every tick. It is a scene, or a wrapper of one.
///
/// Real-time: reset and answer. Threads: one at a time.
class Touchable {
 public:
  virtual ~Touchable() = default;

  /// Clears contacts and their history.
  virtual void reset() noexcept = 0;
  [[nodiscard]] virtual SceneAnswer answer(const Touch& touch) noexcept = 0;

  /// Runs after every tick, outside of it, as in Controller. It may wait only on a virtual clock, which stands still
  /// meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }

  /// Returns notes for the user about the past session.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }
};

/// Where a scene comes from.
struct SceneSource {
  std::string text;                ///< of its file
  std::vector<std::string> files;  ///< paths of the files that it names
  std::string folder;              ///< of its file; empty: the current one
};

struct SceneOptions {
  bool passivity = false;  ///< a passivity layer supervises the sum
  PointTool tool;
  SceneSource source;
};

/// A set of independent objects; their forces add up. The cost is the sum of the costs of those near the tool.
///
/// Order of calls: as for an object.
class Scene final : public Touchable {
 public:
  /// Throws Error(input) when there is no object, or when two have the same name.
  explicit Scene(std::vector<std::unique_ptr<Object>> objects, const SceneOptions& options = {});

  /// Prepares every object. Throws their errors, and Error(input) when the rate is not from 0.1 to 1e6 Hz.
  void prepare(const SceneTiming& timing);
  void reset() noexcept override;
  /// Fills in the touch's last position and velocity.
  [[nodiscard]] SceneAnswer answer(const Touch& touch) noexcept override;

  [[nodiscard]] std::size_t size() const noexcept { return objects_.size(); }
  [[nodiscard]] const Object& object(std::size_t index) const { return *objects_.at(index); }
  [[nodiscard]] std::vector<std::string> names() const;
  [[nodiscard]] const SceneOptions& options() const noexcept { return options_; }
  /// Returns notes for the user on the prepared objects, with their names.
  [[nodiscard]] std::vector<std::string> notes() const;
  /// Returns the names of the objects that lie outside `workspace`.
  [[nodiscard]] std::vector<std::string> out_of(const Box& workspace) const;

  /// Returns the accuracy settings of all objects, as "object.setting".
  [[nodiscard]] std::vector<Knob> knobs() const;
  /// Sets an accuracy setting. Throws Error(input) naming the setting, with the nearest known name.
  void set(const std::string& knob, double level);

 private:
  void ask(std::uint32_t object, const Touch& touch, SceneAnswer& sum) noexcept;
  [[nodiscard]] Box swept(const Touch& touch) const noexcept;

  std::vector<std::unique_ptr<Object>> objects_;
  SceneOptions options_;
  BroadPhase near_;
  double ahead_ = 0;  ///< longest time by which a surface evaluates contacts ahead [s]
  ContactList contacts_;
  std::vector<std::uint32_t> held_;  ///< objects that hold the tool, which may be outside their boxes
  Vec3 last_position_ = nan3(), last_velocity_ = nan3();
};

}  // namespace haptrace
