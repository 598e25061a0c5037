// A session's options for a scene, and its report of the contacts.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace haptrace {

/// Prediction of the force between two answers of a slow scene (Ellis, Sarkar and Jenkins 1996; Basdogan 2000).
enum class Prediction : std::uint8_t {
  hold,    ///< last answer
  linear,  ///< line through the last two answers, over time, for a period; it does not turn a push into a pull, holds
           ///< the pull of an adhesion, and never exceeds 1.5 times the last answer
  model,   ///< plane, stiffness and adhesion of the last contact, at the tool's current position (Adachi, Kumano and
           ///< Ogino 1995); holds the friction of the last answer
};

Prediction parse_prediction(std::string_view name);  ///< "hold" | "linear" | "model"; throws Error(input)
const char* to_string(Prediction prediction) noexcept;

/// Settings of a scene that is slower than the servo loop (SlowScene).
struct SlowSceneOptions {
  double rate_hz = 100;  ///< rate of the queries, rounded so that the period is a whole number of ticks
  Prediction prediction = Prediction::hold;
};

/// Statistics of the contacts with one object.
struct TouchFigures {
  /// Time without contact after which an object counts as left [s].
  static constexpr double kLeft = 0.02;

  std::string name;      ///< name of the object
  int times = 0;         ///< number of contacts; gaps shorter than kLeft are ignored
  double seconds = 0;    ///< total contact time, in which an adhesion pulls or a field acts included [s]
  double max_force = 0;  ///< largest magnitude of the object's answers, before limits and fades [N]
  double max_depth = 0;  ///< [m]
};

}  // namespace haptrace
