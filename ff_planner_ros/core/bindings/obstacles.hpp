// Obstacles as Python holds them: they are not copied with every question.
#pragma once
#include "collision/obstacles.hpp"

namespace ff {

struct Spheres {
  std::vector<Sphere> all;
};

struct Obstacles {
  std::vector<Obstacle> all;
};

}  // namespace ff
