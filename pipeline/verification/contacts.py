"""Proof that nothing is in contact anywhere along a path, by bounds on motion and distances by coal.

Where two bodies are a distance d apart at a point of the path, they are free as far as the one moves, seen from the
other, by less than d (`Motion`). First this is asked of balls and boxes around bodies, at the states of the path and
for all pairs at once; then, for the stretches that remain, of coal at their middles: what a distance does not cover is
asked again, nearer by. Of meshes that are not convex, and of octrees, coal is asked only whether they are nearer than
needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.verification.kinematics import WORLD, Kinematics
from pipeline.verification.motion import Motion, Poses, with_world
from pipeline.verification.pairs import Item, Pair
from pipeline.verification.touching import Asker, Placed, enclosed
from pipeline.verification.verdict import CLEARANCE

_TURN = 0.2  # of joints along a piece of a chord at most [rad]: the bow is a tenth of the motion then
_SLACK = 3e-6  # of distances by coal [m]: at most 2.7e-6 too long in 200 000, against tolerances of 1e-12 (3.0.3)
_FINEST = 5e-6  # half of a stretch [m]: what is not proven then is sampled only
_QUERIES = 30_000  # of coal for one path, after which stretches are no shorter than half of CLEARANCE
_WIDE = 0.05  # half of a stretch [m]: of longer ones coal is not asked
_AT_ONCE = 25_000  # pairs that are looked at together


@dataclass(frozen=True)
class Contact:
    """Where a path is in contact.

    Attributes:
        chord: number of it.
        state: configuration (n,).
        first, second: names of what meets.
        depth: how deep they are in each other [m]; NaN where that is not known.
        allowed: how deep they may be [m].
    """

    chord: int
    state: np.ndarray
    first: str
    second: str
    depth: float
    allowed: float


@dataclass
class Found:
    """What the check of a path for contact found.

    Attributes:
        contact: the first along the path; None where there is none.
        sampled: chords of which a part is nearer to contact than can be proven.
        queries: of coal.
    """

    contact: Contact | None = None
    sampled: set[int] = field(default_factory=set)
    queries: int = 0


class Contacts:
    """Proves that paths are free of contact.

    Args:
        kinematics: of the robot.
        items: of robot and obstacles.
        pairs: of items that are held against each other.
    """

    def __init__(self, kinematics: Kinematics, items: Sequence[Item], pairs: Sequence[Pair]) -> None:
        self._kinematics, self.items, self._ask = kinematics, items, Asker()
        corners = [item.form.moving @ item.place.R.T + item.place.p for item in items]
        radius = [float(np.linalg.norm(points, axis=1).max()) for points in corners]
        moving = [i for i, item in enumerate(items) if item.joint != WORLD]
        views = {(i, WORLD): row for row, i in enumerate(moving)}
        self._worlds = len(views)
        rows = []
        for pair in pairs:
            one, other = pair.first, pair.second
            if items[other].joint != WORLD and radius[other] < radius[one]:
                one, other = other, one
            view = views.setdefault((one, items[other].joint), len(views))
            rows.append((one, other, view))
        self._first, self._second, self._view = np.array(rows, int).reshape(-1, 3).T
        self._seen_from_world = np.array([views.get((i, WORLD), -1) for i in range(len(items))], int)
        self._depth = np.array([pair.depth for pair in pairs], float)
        self._motion = Motion(kinematics, items, list(views))
        self._joint = np.array([item.joint for item in items], int)
        self._R = np.array([item.place.R for item in items]).reshape(-1, 3, 3)
        self._p = np.array([item.place.p for item in items]).reshape(-1, 3)
        self._middle = np.array([item.form.middle for item in items]).reshape(-1, 3)
        self._half = np.array([item.form.half for item in items]).reshape(-1, 3)
        self._radius = np.array([item.form.radius for item in items], float)
        self._convex = np.array([item.form.convex for item in items], bool)
        self._solid = np.array([item.form.inside is not None for item in items], bool)

    def check(self, path: np.ndarray) -> Found:
        """Look for contact along a path (T, n), T >= 1, of finite states."""
        found = Found()
        if not len(self._first):
            return found
        if len(path) == 1:
            path = np.repeat(path, 2, axis=0)
        states, chords = self._pieces(path)
        poses, along = self._followed(states)
        placed = with_world(poses)
        every = np.arange(len(self._first))
        for state in (len(states) - 1, 0):
            for pair in self._enclosed(placed, state)[:1].tolist():
                chord = int(chords[min(state, len(chords) - 1)])
                found.contact = Contact(chord, states[state], *self._names(pair), np.nan, 0.0)
        if found.contact is not None and found.contact.chord == 0:
            return found
        # Seen from the world first, which few views tell; from each other only where that does not do.
        both = self._view >= self._worlds
        stretches = [self._rough(placed, pairs, along) for pairs in _blocks(every)]
        left = np.concatenate(stretches)
        close = np.unique(left[both[left[:, 0]], 0])
        if len(close):
            rows = np.unique(self._view[close])
            along[rows, 1:] = np.cumsum(self._motion.rates(states, poses, rows), axis=1)
            stretches = [self._rough(placed, pairs, along, relative=True) for pairs in _blocks(close)]
            left = np.concatenate([left[~both[left[:, 0]]], *stretches])
        self._fine(left, states, chords, along, found)
        return found

    def least(self, Q: np.ndarray) -> float:
        """Return the least distance to obstacles over states Q (T, n) [m], of pairs that may not touch; inf without."""
        chosen = np.flatnonzero((self._depth == 0) & self._to_obstacle)
        if not len(chosen):
            return np.inf
        poses, along = self._followed(Q)
        best = np.inf
        for row in (0, len(Q) - 1):
            for pair in self._enclosed(with_world(poses), row).tolist():
                best = min(best, self._ask.clearance(*self._placed(pair, with_world(poses), row)))
        for pairs in _blocks(chosen):
            best = self._least(pairs, with_world(poses), along, best)
        return best

    def _least(self, pairs: np.ndarray, placed: Poses, along: np.ndarray, best: float) -> float:
        """Return the least distance of pairs (N,) over states, or `best` where that is less [m]."""
        now = np.stack([pairs, np.zeros_like(pairs), np.full_like(pairs, along.shape[1] - 1)], axis=1)
        while len(now):
            pair, low, high = now.T
            middle = (low + high) // 2
            view = self._view[pair]
            bound = self._bounds(pair, placed, middle)
            way = np.maximum(along[view, middle] - along[view, low], along[view, high] - along[view, middle])
            convex = self._convex[self._first[pair]] & self._convex[self._second[pair]]
            asked = np.flatnonzero(np.where(convex, bound, bound - way) < best)
            for i in asked[np.argsort(bound[asked], kind="stable")].tolist():
                if bound[i] < best or (not convex[i] and bound[i] - way[i] < best):
                    here, there = self._placed(int(pair[i]), placed, int(middle[i]))
                    bound[i] = self._apart(here, there, float(bound[i]), best, float(way[i]))
                    best = min(best, float(bound[i]))
            kept = bound - way < best  # at other states between
            pair, low, middle, high = pair[kept], low[kept], middle[kept], high[kept]
            before, after = np.stack([pair, low, middle - 1], axis=1), np.stack([pair, middle + 1, high], axis=1)
            now = np.concatenate([before[low < middle], after[middle < high]])
        return best

    def _apart(self, here: Placed, there: Placed, bound: float, best: float, way: float) -> float:
        """Return how far two items are apart at least [m], exactly where they are nearer than `best`.

        Of meshes and octrees, whether they are nearer than something is told much faster than how far they are.
        """
        if here[0].convex and there[0].convex:
            return self._ask.distance(here, there)
        if 0 <= best < np.inf:
            if not self._ask.nearer(here, there, best + way):
                return best + way
            if bound >= best or not self._ask.nearer(here, there, best):
                return max(bound, best)
        return self._ask.distance(here, there)

    def deepest(self, Q: np.ndarray) -> tuple[str, str, float] | None:
        """Return the names and the depth [m] of the pair that may touch and is deepest at rows of Q (T, n)."""
        chosen = np.flatnonzero(self._depth > 0)
        best: tuple[str, str, float] | None = None
        poses = with_world(self._kinematics.joint_poses(Q))
        for pair in chosen.tolist():
            for state in np.flatnonzero(self._bounds(np.full(len(Q), pair), poses, np.arange(len(Q))) <= 0).tolist():
                depth = -self._ask.distance(*self._placed(pair, poses, state))
                if depth > (best[2] if best else 0.0):
                    best = (*self._names(pair), depth)
        return best

    @property
    def _to_obstacle(self) -> np.ndarray:
        bodies = np.array([item.body for item in self.items], int)
        return np.asarray((bodies[self._second] < 0) | (bodies[self._first] < 0))

    def _followed(self, states: np.ndarray) -> tuple[Poses, np.ndarray]:
        """Return the poses of joints at states (T, n), and how far items move on the way to each (views + 1, T) [m]."""
        poses = self._kinematics.joint_poses(states)
        along, rows = np.zeros((self._motion.count + 1, len(states))), np.arange(self._worlds)  # -1 does not move
        along[rows, 1:] = np.cumsum(self._motion.rates(states, poses, rows), axis=1)
        return poses, along

    def _pieces(self, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (M, n) with those put in that keep joints from turning far, and the chord of each piece."""
        turned = np.abs(np.diff(path, axis=0)) @ self._kinematics.turning.astype(float)
        count = np.maximum(np.ceil(turned / _TURN).astype(int), 1)
        chord = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(chord)) - (np.cumsum(count) - count)[chord]) / count[chord]
        states = path[chord] + share[:, None] * (path[chord + 1] - path[chord])
        return np.concatenate([states, path[-1:]]), chord

    def _rough(self, placed: Poses, pairs: np.ndarray, along: np.ndarray, relative: bool = False) -> np.ndarray:
        """Return the stretches (N, 3) of states, as pair, first and last state, that balls and boxes do not prove.

        Two items that move come nearer by no more than both move, or than one moves as the other sees it (`relative`).
        """
        last = along.shape[1] - 1
        left = [np.empty((0, 3), int)]
        now = np.stack([pairs, np.zeros_like(pairs), np.full_like(pairs, last)], axis=1)
        while len(now):
            pair, low, high = now.T
            middle = (low + high) // 2
            way = np.zeros(len(pair))
            worlds = self._seen_from_world[self._first[pair]], self._seen_from_world[self._second[pair]]
            for view in [self._view[pair]] if relative else worlds:
                way += np.maximum(along[view, middle] - along[view, low], along[view, high] - along[view, middle])
            now = now[self._bounds(pair, placed, middle) + self._depth[pair] - _SLACK <= way]
            pair, low, high = now.T
            single = high - low == 1
            left.append(now[single])
            pair, low, high = now[~single].T
            middle = (low + high) // 2
            now = np.concatenate([np.stack([pair, low, middle], axis=1), np.stack([pair, middle, high], axis=1)])
        return np.concatenate(left)

    def _fine(
        self, stretches: np.ndarray, states: np.ndarray, chords: np.ndarray, along: np.ndarray, found: Found
    ) -> None:
        """Prove stretches (N, 3) of one piece each by coal; write what is found."""
        count = len(states)
        # All views one after the other, so that a way says which view and which piece it is of.
        offsets = np.concatenate([[0.0], np.cumsum(along[:, -1] + 1.0)[:-1]])
        ways = (along + offsets[:, None]).ravel()
        order = np.lexsort((stretches[:, 1], stretches[:, 0]))
        pair, low, high = stretches[order].T
        if not len(pair):
            return
        # Neighbouring ones are one, up to a length.
        begin = np.ones(len(pair), bool)
        begin[1:] = (pair[1:] != pair[:-1]) | (low[1:] != high[:-1])
        first = self._view[pair] * count
        lengths = ways[first + high] - ways[first + low]
        total = np.cumsum(lengths)
        run = np.cumsum(begin) - 1
        within = total - lengths - (total - lengths)[np.flatnonzero(begin)][run]
        begin[1:] |= np.floor(within[1:] / _WIDE) != np.floor(within[:-1] / _WIDE)
        at = np.flatnonzero(begin)
        end = np.append(at[1:], len(pair)) - 1
        pair, lo, hi = pair[at], ways[first[at] + low[at]], ways[first[at] + high[end]]
        while len(pair):
            middle, half = (lo + hi) / 2, (hi - lo) / 2
            k = np.searchsorted(ways, middle, side="right") - 1
            piece = np.minimum(k - self._view[pair] * count, count - 2)
            k = piece + self._view[pair] * count
            share = np.clip((middle - ways[k]) / (ways[k + 1] - ways[k]), 0, 1)
            Q = states[piece] + share[:, None] * (states[piece + 1] - states[piece])
            reach, met = self._reach(pair, Q, half, found)
            if met.any():
                self._note_contact(pair, Q, chords[piece], share + piece, met, reach, found)
            finest = _FINEST if found.queries < _QUERIES else CLEARANCE / 2
            open_ones = ~met & (reach < half)
            small = open_ones & (half <= finest)
            found.sampled.update(chords[piece[small]].tolist())
            again = (open_ones & ~small) | met
            reach = np.maximum(np.where(met, 0.0, reach), 0.0)[again]
            pair, lo, hi, middle = pair[again], lo[again], hi[again], middle[again]
            pair, lo, hi = np.tile(pair, 2), np.concatenate([lo, middle + reach]), np.concatenate([middle - reach, hi])
            if found.contact is not None:  # only what is before it can be first
                k = np.searchsorted(ways, lo, side="right") - 1
                piece = np.minimum(k - self._view[pair] * count, count - 2)
                before = chords[piece] < found.contact.chord
                pair, lo, hi = pair[before], lo[before], hi[before]

    def _reach(self, pair: np.ndarray, Q: np.ndarray, half: np.ndarray, found: Found) -> tuple[np.ndarray, np.ndarray]:
        """Return how far pairs are proven to be free around configurations (N,) [m], and which are in contact (N,)."""
        poses = with_world(self._kinematics.joint_poses(Q))
        rows = np.arange(len(pair))
        reach = self._bounds(pair, poses, rows) + self._depth[pair] - _SLACK
        met = np.zeros(len(pair), bool)
        asked = np.flatnonzero(reach < half)
        one, other = self._first[pair[asked]], self._second[pair[asked]]
        R1, p1 = self._item_poses(one, poses, asked)
        R2, p2 = self._item_poses(other, poses, asked)
        convex = self._convex[one] & self._convex[other]
        forms, depth = [item.form for item in self.items], self._depth[pair[asked]]
        found.queries += len(asked)
        for i, (row, a, b) in enumerate(zip(asked.tolist(), one.tolist(), other.tolist(), strict=True)):
            here, there = (forms[a], R1[i], p1[i]), (forms[b], R2[i], p2[i])
            if convex[i]:
                apart = self._ask.distance(here, there) + depth[i]
                met[row], reach[row] = apart <= 0, apart - _SLACK
            elif not self._ask.nearer(here, there, float(half[row])):
                reach[row] = half[row]
            else:
                reach[row] = max(reach[row], 0.0)
                met[row] = self._ask.nearer(here, there, 0.0)
        return reach, met

    def _enclosed(self, placed: Poses, state: int) -> np.ndarray:
        """Return the pairs of which one is inside a closed mesh at a state: where surfaces never meet it stays so."""
        chosen = np.flatnonzero(self._solid[self._first] | self._solid[self._second])
        if len(chosen):
            chosen = chosen[self._bounds(chosen, placed, np.full(len(chosen), state)) <= 0]
        return np.array([pair for pair in chosen.tolist() if enclosed(*self._placed(pair, placed, state))], int)

    def _note_contact(
        self,
        pair: np.ndarray,
        Q: np.ndarray,
        chord: np.ndarray,
        place: np.ndarray,
        met: np.ndarray,
        reach: np.ndarray,
        found: Found,
    ) -> None:
        """Keep the first contact along the path."""
        rows = np.flatnonzero(met)
        i = int(rows[np.lexsort((place[rows], chord[rows]))[0]])
        if found.contact is None or chord[i] < found.contact.chord:
            one, other, allowed = self._first[pair[i]], self._second[pair[i]], float(self._depth[pair[i]])
            known = bool(self._convex[one] & self._convex[other])
            depth = allowed - float(reach[i]) if known else np.nan
            found.contact = Contact(int(chord[i]), Q[i], *self._names(int(pair[i])), depth, allowed)

    def _names(self, pair: int) -> tuple[str, str]:
        return self.items[self._first[pair]].name, self.items[self._second[pair]].name

    def _placed(self, pair: int, poses: Poses, row: int) -> tuple[Placed, Placed]:
        """Return a pair's items where they are at a row of poses."""
        found = []
        for number in (int(self._first[pair]), int(self._second[pair])):
            R, p = self._item_poses(np.array([number]), poses, np.array([row]))
            found.append((self.items[number].form, R[0], p[0]))
        return found[0], found[1]

    def _item_poses(self, items: np.ndarray, poses: Poses, rows: np.ndarray) -> Poses:
        """Return rotations (N, 3, 3) and positions (N, 3) of items at rows of poses with the world."""
        R, p = poses[0][rows, self._joint[items]], poses[1][rows, self._joint[items]]
        return R @ self._R[items], np.einsum("nij,nj->ni", R, self._p[items]) + p

    def _bounds(self, pair: np.ndarray, poses: Poses, rows: np.ndarray) -> np.ndarray:
        """Return what pairs are apart at least, at rows of poses (N,) [m], by balls and boxes around them."""
        one, other = self._first[pair], self._second[pair]
        R1, p1 = self._item_poses(one, poses, rows)
        R2, p2 = self._item_poses(other, poses, rows)
        apart = np.einsum("nij,nj->ni", R2, self._middle[other]) + p2
        apart -= np.einsum("nij,nj->ni", R1, self._middle[one]) + p1
        found = np.linalg.norm(apart, axis=1) - self._radius[one] - self._radius[other]
        for R, near, far in ((R1, one, other), (R2, other, one)):
            beyond = np.abs(np.einsum("nji,nj->ni", R, apart)) - self._half[near]
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
            found = np.maximum(found, outside - self._radius[far])
        return np.asarray(found)


def _blocks(pairs: np.ndarray) -> list[np.ndarray]:
    """Return pairs (N,) in parts that are looked at together."""
    return np.array_split(pairs, len(pairs) // _AT_ONCE + 1)
