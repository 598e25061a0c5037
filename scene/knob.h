// Settings that trade accuracy for speed.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// A setting that trades accuracy for speed.
struct Knob {
  std::string name;            ///< key of the object in a scene file
  std::string unit;            ///< SI; empty if dimensionless
  std::vector<double> levels;  ///< levels worth trying, from the fastest to the most accurate
  double level = 0;            ///< current level
  double least = 0, most = 0;  ///< range of the level
};

/// A part of an object that has such settings.
class Adjustable {
 public:
  virtual ~Adjustable() = default;

  [[nodiscard]] virtual std::vector<Knob> knobs() const { return {}; }

  /// Sets one of knobs() to a level within its range; whoever calls it has checked both. Takes effect at the next
  /// preparation.
  virtual void set(const std::string& knob, double level) {
    (void)knob;
    (void)level;
  }
};

}  // namespace haptrace
