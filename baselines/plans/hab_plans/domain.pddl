; The predicates and actions of the paper's planner (S H.1), one action for each skill.
;
; S H.1 writes conditions on what the start says, "is_open(Z) if in(X, Z)". Here every item is in some
; container, and the room is one that is always open: that keeps the domain plain STRIPS, for which the
; planner proves that its plans are minimal. "hand-empty" stands for "not holding(Z) for all Z", and
; "at-robot(X)" for "at(robot, X)". A door that stands ajar is neither open nor closed: open asks for one
; that is not open, and close for one that is not closed.
(define (domain home-assistant)
  (:requirements :strips :typing :negative-preconditions)
  (:types item goal container pose - thing)
  (:predicates
    (at-robot ?x - thing)
    (at ?x - item ?y - goal)
    (in ?x - item ?z - container)
    (goal-in ?y - goal ?z - container)
    (inside ?y ?z - goal)
    (free-standing ?y - goal)
    (holding ?x - item)
    (hand-empty)
    (articulated ?z - container)
    (is-open ?z - container)
    (is-closed ?z - container)
    (placed ?x - item))

  (:action navigate
    :parameters (?from ?to - thing)
    :precondition (and (at-robot ?from) (not (at-robot ?to)))
    :effect (and (at-robot ?to) (not (at-robot ?from))))

  (:action pick
    :parameters (?x - item ?z - container)
    :precondition (and (at-robot ?x) (hand-empty) (not (placed ?x)) (in ?x ?z) (is-open ?z))
    :effect (and (holding ?x) (not (hand-empty))))

  (:action place
    :parameters (?x - item ?y - goal ?c - container)
    :precondition (and (at-robot ?y) (holding ?x) (free-standing ?y) (goal-in ?y ?c) (is-open ?c))
    :effect (and (at ?x ?y) (placed ?x) (hand-empty) (not (holding ?x))))

  ; A goal inside another one, as the fruit's in the bowl's, is there once the other is filled.
  (:action place-inside
    :parameters (?x - item ?y - goal ?other - item ?z - goal ?c - container)
    :precondition (and (at-robot ?y) (holding ?x) (inside ?y ?z) (at ?other ?z)
      (goal-in ?y ?c) (is-open ?c))
    :effect (and (at ?x ?y) (placed ?x) (hand-empty) (not (holding ?x))))

  (:action open
    :parameters (?z - container)
    :precondition (and (at-robot ?z) (articulated ?z) (not (is-open ?z)) (hand-empty))
    :effect (and (is-open ?z) (not (is-closed ?z))))

  (:action close
    :parameters (?z - container)
    :precondition (and (at-robot ?z) (articulated ?z) (not (is-closed ?z)) (hand-empty))
    :effect (and (is-closed ?z) (not (is-open ?z)))))
