# SPDX-License-Identifier: Apache-2.0
"""What others use to find bright spots, each tuned on the first images of what it will see."""

import importlib.util
import sys
import time
import warnings

import cv2
import numpy as np

from eol_ros.errors import pip_install

_AREA_PX = (700, 4500)  # of a block of 46 px, tilted or partly hidden


class SimpleBlobDetector:
    """cv2.SimpleBlobDetector: contours at many thresholds, as in TouchDesigner's Blob TOP."""

    name = 'SimpleBlobDetector'
    choices = ((30, 200, 24), (50, 210, 20), (70, 230, 20), (20, 110, 12))

    def __init__(self, choice):
        p = cv2.SimpleBlobDetector_Params()
        p.minThreshold, p.maxThreshold, p.thresholdStep = choice
        p.filterByColor, p.blobColor = True, 255
        p.filterByArea, p.minArea, p.maxArea = True, *_AREA_PX
        p.filterByCircularity = p.filterByInertia = False
        p.filterByConvexity, p.minConvexity = True, 0.8
        p.minDistBetweenBlobs = 25
        self.detector = cv2.SimpleBlobDetector_create(p)

    def find(self, image):
        """Return centres (n, 2)."""
        return np.array([k.pt for k in self.detector.detect(image)]).reshape(-1, 2)


class ConnectedComponents:
    """cv2.connectedComponentsWithStats, then the intensity centroid of each region."""

    name = 'components + moments'
    choices = (30, 50, 70, 100)

    def __init__(self, choice):
        self.level = choice

    def find(self, image):
        """Return centres (n, 2)."""
        mask = cv2.threshold(image, self.level, 255, cv2.THRESH_BINARY)[1]
        n, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        found = []
        for i in range(1, n):
            x, y, w, h, area = stats[i]
            if _AREA_PX[0] <= area <= _AREA_PX[1]:
                part = np.where(labels[y : y + h, x : x + w] == i, image[y : y + h, x : x + w], 0)
                m = cv2.moments(part.astype(np.float32))
                found.append((x + m['m10'] / m['m00'], y + m['m01'] / m['m00']))
        return np.array(found).reshape(-1, 2)


class Contours:
    """Blur, threshold, contours and the rectangle of least area, as in CCV and ofxCv."""

    name = 'contours + minAreaRect'
    choices = (30, 50, 70, 100)

    def __init__(self, choice):
        self.level = choice

    def find(self, image):
        """Return centres (n, 2)."""
        smooth = cv2.blur(image, (3, 3))
        mask = cv2.threshold(smooth, self.level, 255, cv2.THRESH_BINARY)[1]
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return np.array(
            [
                cv2.minAreaRect(c)[0]
                for c in contours
                if _AREA_PX[0] <= cv2.contourArea(c) <= _AREA_PX[1]
            ]
        ).reshape(-1, 2)


class Trackpy:
    """trackpy.locate on the image at a quarter of its size, where squares are spots to it."""

    name = 'trackpy, quarter size'
    choices = ((15, 0.3), (17, 0.3), (17, 0.6))

    def __init__(self, choice):
        import trackpy

        trackpy.quiet()
        self.trackpy = trackpy
        self.diameter, self.share = choice

    def find(self, image):
        """Return centres (n, 2)."""
        small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        with np.errstate(divide='ignore'), warnings.catch_warnings():
            warnings.simplefilter('ignore')  # pandas warns of what trackpy does
            found = self.trackpy.locate(small, self.diameter, separation=13, engine='numba')
        found = found[found['mass'] > self.share * found['mass'].nlargest(25).median()]
        return np.column_stack([found['x'], found['y']]) * 4 + 1.5


def peers() -> tuple:
    """Return the peers that are installed; trackpy is named where it is not."""
    found = (SimpleBlobDetector, ConnectedComponents, Contours)
    if importlib.util.find_spec('trackpy') is None:
        print(f'trackpy is left out: {pip_install("trackpy")}', file=sys.stderr)
        return found
    return (*found, Trackpy)


def tuned(peer, images, truths):
    """Return `peer` at the setting that finds most blocks, and those best, in a few images."""
    best, chosen = (-1.0, 0.0), None
    for choice in peer.choices:
        candidate = peer(choice)
        scores = [
            match(candidate.find(image), truth) for image, truth in zip(images, truths, strict=True)
        ]
        far = np.concatenate([s[0] for s in scores])
        false = sum(s[1] for s in scores)
        hits = (far < 5).sum() - false
        score = (float(hits), -float(np.median(far)))
        if score > best or chosen is None:
            best, chosen = score, candidate
    return chosen


def match(found: np.ndarray, truth: np.ndarray, reach_px: float = 20.0):
    """Return the distance (n,) from each true centre to the nearest found, and the false ones."""
    if not len(found):
        return np.full(len(truth), np.inf), 0
    far = np.hypot(found[:, None, 0] - truth[:, 0], found[:, None, 1] - truth[:, 1])
    return far.min(axis=0), int((far.min(axis=1) > reach_px).sum())


def errors(found: np.ndarray, truth: np.ndarray, reach_px: float = 20.0) -> np.ndarray:
    """Return found minus true (n, 2) px, NaN where nothing lies within reach."""
    left = np.full(truth.shape, np.nan)
    if len(found):
        far = np.hypot(found[:, None, 0] - truth[:, 0], found[:, None, 1] - truth[:, 1])
        near = far.argmin(axis=0)
        hit = far.min(axis=0) < reach_px
        left[hit] = (found[near] - truth)[hit]
    return left


def timed(call, *args):
    """Return (result, milliseconds of this thread on its core).

    Time on the core, not on the wall: on a shared machine the wall measures the neighbours.
    """
    begin = time.thread_time()
    result = call(*args)
    return result, (time.thread_time() - begin) * 1e3
