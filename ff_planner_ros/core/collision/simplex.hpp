// The simplex with which GJK closes in on the point of two solids' difference next to the origin.
#pragma once
#include <array>

#include "kinematics/spatial.hpp"

namespace ff {

// Closest point to the origin of a simplex, with the weights of its vertices; vertices without
// weight are dropped. Returns false where the origin is inside.
class Simplex {
 public:
  int size = 0;

  void add(const Vector3& a, const Vector3& b, const Pose& first, const Pose& second);
  // The same points of solids that have moved.
  void move(const Pose& first, const Pose& second);
  const Vector3& newest() const { return difference(size - 1); }
  Vector3 closest() const { return weighted(&Vertex::difference); }
  Vector3 on_first_solid() const { return weighted(&Vertex::on_first); }

  bool reduce();

 private:
  struct Vertex {
    Vector3 difference;           // of points of both solids
    Vector3 on_first, on_second;  // these points, each in the frame of its solid
  };
  struct Part {
    double square = 1e300;
    int size = 0;
    std::array<int, 3> vertex = {};
    std::array<double, 3> weight = {};
  };

  const Vector3& difference(int i) const { return vertex_[i].difference; }
  Vector3 weighted(Vector3 Vertex::* of) const;

  void take(const Part& part);

  Part point(int i) const { return {difference(i).squaredNorm(), 1, {i}, {1}}; }

  Part segment(int i, int j) const;

  Part triangle(int i, int j, int k) const;

  std::array<Vertex, 4> vertex_;
  std::array<double, 3> weight_;
};

}  // namespace ff
