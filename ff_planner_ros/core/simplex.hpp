// The simplex with which GJK closes in on the point of two solids' difference next to the origin.
#pragma once
#include "spatial.hpp"

namespace ff {

// Closest point to the origin of a simplex, with the weights of its vertices; vertices without
// weight are dropped. Returns false where the origin is inside.
class Simplex {
 public:
  int size = 0;
  Vector3 difference[4];              // of points of both solids
  Vector3 on_first[4], on_second[4];  // these points, each in the frame of its solid
  double weight[4];

  void add(const Vector3& a, const Vector3& b, const Pose& first, const Pose& second) {
    on_first[size] = a, on_second[size] = b;
    difference[size++] = first * a - second * b;
  }
  // The same points of solids that have moved.
  void move(const Pose& first, const Pose& second) {
    for (int i = 0; i < size; ++i) difference[i] = first * on_first[i] - second * on_second[i];
  }
  Vector3 closest() const { return weighted(difference); }
  Vector3 on_first_solid() const { return weighted(on_first); }

  bool reduce() {
    switch (size) {
      case 1:
        weight[0] = 1;
        return true;
      case 2:
        take(segment(0, 1));
        return true;
      case 3:
        take(triangle(0, 1, 2));
        return true;
      default: {
        Part best;
        static constexpr int faces[4][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}, {1, 3, 2, 0}};
        for (const auto& [a, b, c, opposite] : faces) {
          const Vector3 normal =
              (difference[b] - difference[a]).cross(difference[c] - difference[a]);
          const double origin = -difference[a].dot(normal);
          const double inside = (difference[opposite] - difference[a]).dot(normal);
          if (origin * inside > 1e-24) continue;  // behind this face, as the fourth vertex is
          const Part part = triangle(a, b, c);
          if (part.square < best.square) best = part;
        }
        if (best.size == 0) return false;
        take(best);
        return true;
      }
    }
  }

 private:
  struct Part {
    double square = 1e300;
    int size = 0, vertex[3] = {};
    double weight[3] = {};
  };

  Vector3 weighted(const Vector3* of) const {
    Vector3 sum = Vector3::Zero();
    for (int i = 0; i < size; ++i) sum += weight[i] * of[i];
    return sum;
  }

  void take(const Part& part) {
    Vector3 d[3], a[3], b[3];
    for (int i = 0; i < part.size; ++i) {
      const int from = part.vertex[i];
      d[i] = difference[from], a[i] = on_first[from], b[i] = on_second[from];
    }
    size = part.size;
    for (int i = 0; i < size; ++i)
      difference[i] = d[i], on_first[i] = a[i], on_second[i] = b[i], weight[i] = part.weight[i];
  }

  Part point(int i) const {
    Part part;
    part.square = difference[i].squaredNorm();
    part.size = 1, part.vertex[0] = i, part.weight[0] = 1;
    return part;
  }

  Part segment(int i, int j) const {
    const Vector3 along = difference[j] - difference[i];
    const double square = along.squaredNorm();
    const double t = square > 0 ? -difference[i].dot(along) / square : 0;
    if (t <= 0) return point(i);
    if (t >= 1) return point(j);
    Part part;
    part.square = (difference[i] + t * along).squaredNorm();
    part.size = 2;
    part.vertex[0] = i, part.vertex[1] = j;
    part.weight[0] = 1 - t, part.weight[1] = t;
    return part;
  }

  Part triangle(int i, int j, int k) const {
    const Vector3 &a = difference[i], &b = difference[j], &c = difference[k];
    const Vector3 normal = (b - a).cross(c - a);
    const double square = normal.squaredNorm();
    const double u = b.cross(c).dot(normal), v = c.cross(a).dot(normal), w = a.cross(b).dot(normal);
    if (square > 1e-30 && u > 0 && v > 0 && w > 0) {
      Part part;
      part.size = 3;
      part.vertex[0] = i, part.vertex[1] = j, part.vertex[2] = k;
      const double sum = u + v + w;
      part.weight[0] = u / sum, part.weight[1] = v / sum, part.weight[2] = w / sum;
      part.square = (part.weight[0] * a + part.weight[1] * b + part.weight[2] * c).squaredNorm();
      return part;
    }
    Part best = segment(i, j);
    for (const Part& part : {segment(j, k), segment(k, i)})
      if (part.square < best.square) best = part;
    return best;
  }
};

}  // namespace ff
